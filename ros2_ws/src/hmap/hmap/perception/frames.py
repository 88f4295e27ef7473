"""Poses that are measured in a frame of their own, brought to the world frame by what tf tells."""

import threading
from collections.abc import Sequence

import numpy as np
from tf2_msgs.msg import TFMessage

from hmap_core import transforms
from hmap_msgs_py.checks import ConversionError, poses
from hmap_msgs_py.world import WORLD_FRAME

LONGEST = 50  # frames in a chain


class Frames:
    """The newest transforms of tf, as a tree."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, np.ndarray]] = {}  # frame -> its parent, T_parent_frame (7,)
        self._lock = threading.Lock()

    def add(self, message: TFMessage) -> list[str]:
        """Add transforms.

        Returns:
            what is wrong with those that were left out.
        """
        problems = []
        for entry in message.transforms:
            child, parent = entry.child_frame_id.removeprefix("/"), entry.header.frame_id.removeprefix("/")
            p, q = entry.transform.translation, entry.transform.rotation
            try:
                T = poses(f"the transform of {child!r}", [np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])], 1)[0]
            except ConversionError as error:
                problems.append(str(error))
                continue
            with self._lock:
                self._parents[child] = parent, T
        return problems

    def to_world(self, frame: str, worlds: Sequence[str] = (WORLD_FRAME,)) -> np.ndarray | None:
        """T_world_frame (7,); None where tf knows no way from one of the names of the world frame.

        Args:
            frame: its name.
            worlds: names that mean the world frame.
        """
        name, T = frame.removeprefix("/"), transforms.pose((0.0, 0.0, 0.0))
        with self._lock:
            for _ in range(LONGEST):
                if name in worlds:
                    return T
                if name not in self._parents:
                    return None
                name, T_parent_name = self._parents[name]
                T = transforms.multiply(T_parent_name, T)
        return None
