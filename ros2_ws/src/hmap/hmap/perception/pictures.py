"""Depth pictures with instance masks: messages are collected until those with the same stamp are complete."""

import threading
from dataclasses import dataclass, field

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.types import Camera
from hmap_msgs_py.images import depth_from_message, image_from_message
from hmap_msgs_py.times import seconds_from_message

PARTS = ("depth", "info", "mask", "names")
# incomplete pictures per camera: masks are slow, and depth images arrive in the meantime; 1 s at 30 Hz
KEPT = 30


@dataclass(frozen=True)
class Picture:
    """What one camera saw at one instant.

    Attributes:
        camera: the camera.
        time: s.
        depth: (H, W) m, NaN without a measurement.
        mask: (H, W) instance numbers.
        names: body -> its number.
        intrinsics: (3, 3) pinhole matrix.
    """

    camera: Camera
    time: float
    depth: np.ndarray
    mask: np.ndarray
    names: dict[str, int]
    intrinsics: np.ndarray


@dataclass
class PictureParts:
    """Collects depth, mask, names and camera info with the same stamp, in any order and with any delay."""

    camera: Camera
    _incomplete: dict[tuple[int, int], dict[str, object]] = field(default_factory=dict)  # stamp -> parts
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, part: str, message) -> Picture | None:
        """Add a message.

        Args:
            part: one of PARTS.
            message: the message.

        Returns:
            The picture once it is complete, otherwise None.

        Raises:
            InputError: the camera info has no focal lengths, or names and numbers differ in length.
            ConversionError: an image is malformed.
        """
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
            del self._incomplete[next(iter(self._incomplete))]  # the oldest one

    def _picture(self, depth, info, mask, names) -> Picture:
        K = np.array(info.k, float).reshape(3, 3)
        if not (np.isfinite(K).all() and K[0, 0] > 0.0 and K[1, 1] > 0.0):
            raise InputError(f"camera {self.camera.name!r}: the camera info has no focal lengths")
        if len(names.names) != len(names.numbers):
            raise InputError(f"camera {self.camera.name!r}: {len(names.names)} names for {len(names.numbers)} numbers")
        numbers = dict(zip(names.names, (int(n) for n in names.numbers), strict=True))
        time = seconds_from_message(depth.header.stamp)
        return Picture(self.camera, time, depth_from_message(depth), image_from_message(mask), numbers, K)
