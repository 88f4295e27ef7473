"""Depth pictures with instance masks: kept until the parts of one belong together."""

import threading
from dataclasses import dataclass, field

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.types import Camera
from hmap_msgs_py.images import depth_from_message, image_from_message
from hmap_msgs_py.times import seconds_from_message

PARTS = ("depth", "info", "mask", "names")
KEPT = 30  # incomplete pictures per camera: a mask takes its time, while depth images go on coming; 1 s at 30 Hz


@dataclass(frozen=True)
class Picture:
    """What one camera saw at one instant.

    Attributes:
        time: s.
        depth: (H, W) m, NaN where there is none.
        mask: (H, W) instance numbers.
        names: body -> its number.
        intrinsics: (3, 3).
    """

    camera: Camera
    time: float
    depth: np.ndarray
    mask: np.ndarray
    names: dict[str, int]
    intrinsics: np.ndarray


@dataclass
class PictureParts:
    """Collects depth, mask, names and camera info of the same stamp, in whatever order and however late they come."""

    camera: Camera
    _incomplete: dict[tuple[int, int], dict[str, object]] = field(default_factory=dict)  # stamp -> parts
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, part: str, message) -> Picture | None:
        """Take in a message; the picture, once it is complete."""
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        with self._lock:
            parts = self._incomplete.setdefault(stamp, {})
            parts[part] = message
            if len(parts) < len(PARTS):
                self._forget()
                return None
            del self._incomplete[stamp]
        return self._picture(**parts)

    def _forget(self) -> None:
        while len(self._incomplete) > KEPT:
            del self._incomplete[next(iter(self._incomplete))]  # the first that came

    def _picture(self, depth, info, mask, names) -> Picture:
        K = np.array(info.k, float).reshape(3, 3)
        if not (np.isfinite(K).all() and K[0, 0] > 0.0 and K[1, 1] > 0.0):
            raise InputError(f"camera {self.camera.name!r}: the camera info has no focal lengths")
        if len(names.names) != len(names.numbers):
            raise InputError(f"camera {self.camera.name!r}: {len(names.names)} names for {len(names.numbers)} numbers")
        numbers = dict(zip(names.names, (int(n) for n in names.numbers), strict=True))
        time = seconds_from_message(depth.header.stamp)
        return Picture(self.camera, time, depth_from_message(depth), image_from_message(mask), numbers, K)
