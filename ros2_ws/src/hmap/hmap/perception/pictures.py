"""Depth pictures, with instance masks or without: messages with the same stamp are collected until all are there."""

import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.types import Camera
from hmap_msgs_py.checks import finite, same_length
from hmap_msgs_py.images import depth_from_message, image_from_message
from hmap_msgs_py.measurements import Latest, ReceiverClock
from hmap_msgs_py.times import seconds_from_message

PARTS = ("depth", "info", "mask", "names")
WITHOUT_MASK = ("depth", "info")
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
        problems: what is wrong with names that are left out.
    """

    camera: Camera
    time: float
    depth: np.ndarray
    mask: np.ndarray
    names: dict[str, int]
    intrinsics: np.ndarray
    problems: tuple[str, ...] = ()


@dataclass
class PictureParts:
    """Collects depth, mask, names and camera info with the same stamp, in any order and with any delay.

    A picture that becomes complete after a newer one is left out.

    Attributes:
        camera: the camera.
        clock: judges the stamps; None: they are only compared with each other.
        needed: the parts of a complete picture: PARTS or WITHOUT_MASK.
    """

    camera: Camera
    clock: ReceiverClock | None = None
    needed: tuple[str, ...] = PARTS
    _incomplete: dict[tuple[int, int], dict[str, object]] = field(default_factory=dict)  # stamp -> parts
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self):
        self._complete: Latest[None] = Latest(f"a picture of camera {self.camera.name!r}", self.clock)

    def add(self, part: str, message) -> Picture | None:
        """Add a message.

        Args:
            part: one of those that are needed.
            message: the message.

        Returns:
            The picture once it is complete, unless a newer one was complete before; otherwise None.

        Raises:
            ConversionError: an image or the camera info is malformed, their sizes differ, names and numbers differ in
                length, or the stamp cannot be right.
        """
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        with self._lock:
            parts = self._incomplete.setdefault(stamp, {})
            parts[part] = message
            if len(parts) < len(self.needed):
                self._forget()
                return None
            del self._incomplete[stamp]
            if not self._complete.add(seconds_from_message(message.header.stamp), None):
                return None
        return self._picture(**parts)

    def _forget(self) -> None:
        while len(self._incomplete) > KEPT:
            del self._incomplete[next(iter(self._incomplete))]  # the oldest one

    def _picture(self, depth, info, mask=None, names=None) -> Picture:
        of = f"of camera {self.camera.name!r}"
        K = finite(f"the matrix in the camera info {of}", info.k, (9,)).reshape(3, 3)
        if not (K[0, 0] > 0.0 and K[1, 1] > 0.0):
            raise InputError(f"the camera info {of} has no focal lengths")
        pixels = depth_from_message(depth)
        numbers = np.zeros(pixels.shape, np.int32) if mask is None else image_from_message(mask)
        sizes = {"mask": numbers.shape, "camera info": (info.height, info.width)}
        for what, size in sizes.items():
            if size != pixels.shape and size != (0, 0):  # a camera info may leave it open
                raise InputError(
                    f"the depth picture {of} has {_size(pixels.shape)} pixels and the {what} {_size(size)}; "
                    "they must be the same"
                )
        time = seconds_from_message(depth.header.stamp)
        if names is None:
            return Picture(self.camera, time, pixels, numbers, {}, K)
        same_length(f"the names {of}", names.names, len(names.numbers), "numbers")
        known, problems = instance_names(names.names, [int(number) for number in names.numbers])
        named = tuple(f"the names {of}: {text}" for text in problems)
        return Picture(self.camera, time, pixels, numbers, known, K, named)


def instance_names(names: Sequence[str], numbers: Sequence[int]) -> tuple[dict[str, int], list[str]]:
    """The numbers of named objects in a mask.

    Args:
        names: of the objects; one without a name is left out.
        numbers: of their pixels.

    Returns:
        name -> number, and why names are left out: those that are given several times, and those that share a number.
    """
    pairs = list(dict.fromkeys(zip(names, numbers, strict=True)))
    by_name, by_number = Counter(name for name, _ in pairs), Counter(number for _, number in pairs)
    problems = []
    known = {}
    for name, number in pairs:
        if not name:
            problems.append(f"number {number} has an empty name")
        elif by_name[name] > 1:
            problems.append(f"{name!r} has several numbers")
        elif by_number[number] > 1:
            problems.append(f"{name!r} shares number {number} with another name")
        else:
            known[name] = number
    return known, list(dict.fromkeys(problems))


def _size(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
