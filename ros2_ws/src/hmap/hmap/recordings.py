"""Reads recorded bags for the page: what was measured, planned and done, over time."""

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from hmap.conversions import plan_from_message, scene_from_message, state_from_message
from hmap_core.exceptions import HmapError, InputError
from hmap_core.types import Scene
from hmap_core.viewer.recording import Recording
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.definitions import typestore
from hmap_msgs_py.times import seconds_from_message

TYPES = {  # what is read, by the end of the topic's name
    "scene": "hmap_msgs/msg/Scene",
    "world_state": "hmap_msgs/msg/WorldState",
    "plan": "hmap_msgs/msg/Plan",
    "planner_status": "hmap_msgs/msg/PlannerStatus",
}
PERIOD = 0.04  # s between two states that are kept


def read_bag(path: Path) -> Recording:
    """Read the run of a bag; of several tasks in one bag, the last one.

    Args:
        path: a bag's folder, the folder of a run, or one MCAP file.

    Raises:
        InputError: it cannot be read, or has no ``scene`` and ``world_state``.
    """
    bag = _bag_in(path)
    try:
        with AnyReader([bag], default_typestore=typestore()) as reader:
            chosen = [connection for connection in reader.connections if _is_read(connection)]
            return _read(path, reader, chosen)
    except (HmapError, ConversionError) as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # rosbags raises exceptions of many types for damaged files
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: cannot be read as a bag: {what}") from error


def _bag_in(path: Path) -> Path:
    """What rosbags reads: a folder with metadata, or else an MCAP file.

    Raises:
        InputError: there is no bag.
    """
    if not path.is_dir():
        return path
    for folder in (path, path / "bag"):
        files = sorted(folder.glob("*.mcap")) if folder.is_dir() else []
        if (folder / "metadata.yaml").is_file() or len(files) > 1:
            return folder
        if files:
            return files[0]
    raise InputError(f"{path}: there is no bag in this folder; a bag has metadata.yaml and .mcap files")


def _is_read(connection: Connection) -> bool:
    return TYPES.get(connection.topic.rpartition("/")[2]) == connection.msgtype


def _read(path: Path, reader: AnyReader, connections: list[Connection]) -> Recording:
    """The recording of the connections of an open bag.

    Raises:
        InputError: there is no scene, or no state of it.
    """
    recording: Recording | None = None
    began, refused = 0.0, ""
    for connection, _, raw in reader.messages(connections=connections):
        message: Any = reader.deserialize(raw, connection.msgtype)
        topic = connection.topic.rpartition("/")[2]
        if topic == "scene":
            scene = scene_from_message(message)
            if recording is None or not _same(recording.scene, scene):
                recording = Recording(path.name, scene)
            else:
                recording.scene = scene
        elif recording is not None and topic == "world_state":
            stamp = seconds_from_message(message.header.stamp)
            began = began if recording.times else stamp
            if recording.times and stamp - began < recording.duration + PERIOD:
                continue
            try:
                recording.add(stamp - began, state_from_message(recording.scene, message))
            except (HmapError, ConversionError) as error:  # of another scene: its own comes next
                refused = str(error)
        elif recording is not None and topic == "plan":
            plan = plan_from_message(message)
            recording.plans.append((recording.duration, plan))
            search = plan.stats.get("search")
            if isinstance(search, dict):
                recording.searches.append((recording.duration, search))
        elif recording is not None:
            recording.captions.append((recording.duration, f"{message.phase}: {message.text}"))
    if recording is None:
        raise InputError("nothing was recorded on `scene`")
    if not recording.times:
        raise InputError(f"nothing usable was recorded on `world_state`{f': {refused}' if refused else ''}")
    return recording


def _same(one: Scene, other: Scene) -> bool:
    return (one.task, one.seed) == (other.task, other.seed)
