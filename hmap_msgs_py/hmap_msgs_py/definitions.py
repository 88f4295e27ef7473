"""The definitions of hmap_msgs as text, for reading bags on a machine without ROS.

    from rosbags.highlevel import AnyReader
    from hmap_msgs_py.definitions import typestore

    with AnyReader([Path("run")], default_typestore=typestore()) as reader: ...

``definitions/`` in the source tree is a link to the messages of hmap_msgs; a wheel contains copies.
"""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


def definitions() -> dict[str, str]:
    """Map the name of each type, such as ``hmap_msgs/msg/Plan``, to its definition."""
    return {
        f"{package.name}/msg/{message.name.removesuffix('.msg')}": message.read_text(encoding="utf-8")
        for package in _sorted(files("hmap_msgs_py") / "definitions")
        for message in _sorted(package / "msg")
        if message.name.endswith(".msg")
    }


def typestore() -> Typestore:
    """The types of ROS 2 Jazzy and of hmap for the readers and writers of rosbags, which must be installed."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # an extra of this package

    types = {}
    for name, text in definitions().items():
        types.update(get_types_from_msg(text, name))
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(types)
    return store


def _sorted(folder: Traversable) -> list[Traversable]:
    return sorted(folder.iterdir(), key=lambda entry: entry.name)
