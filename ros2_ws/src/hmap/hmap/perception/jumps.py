"""Measured poses that cannot follow from the last ones: of a lost marker, a swapped body, a wrong frame."""

from dataclasses import dataclass

import numpy as np

from hmap_core import transforms

JUMP, TURN = 0.1, np.deg2rad(45.0)  # m, rad that a pose may change at once
SPEED, TURN_SPEED = 1.5, np.deg2rad(360.0)  # m/s, rad/s; beside that
LONGEST = 0.1  # s for which these count
STAYS = 0.5  # s of measurements at the new place after which it is believed


@dataclass
class Doubt:
    """A place at which a body may be.

    Attributes:
        since: s, the first measurement there.
        until: s, the newest one.
        pose: (7,), the newest one.
        text: what is in doubt.
    """

    since: float
    until: float
    pose: np.ndarray
    text: str


class JumpFilter:
    """Judges the poses of one body, in the order of their stamps."""

    def __init__(self) -> None:
        self._last: tuple[float, np.ndarray] | None = None
        self.doubt: Doubt | None = None  # None: the last pose was plausible

    def accept(self, name: str, time: float, pose: np.ndarray) -> bool:
        """Whether a pose (7,) at a time (s) is to be used; else :attr:`doubt` says why not.

        A pose that has jumped is used once the body has stayed there for STAYS.
        """
        if self._last is None or time < self._last[0]:  # the first one, or one that comes late
            self._last = self._last or (time, pose)
            return True
        if not _far(*self._last, time, pose):
            self._last, self.doubt = (time, pose), None
            return True
        distance, angle = transforms.distance(self._last[1], pose)
        text = (
            f"the pose of {name!r} has jumped by {distance:.3f} m and {np.rad2deg(angle):.0f} deg within "
            f"{time - self._last[0]:.2f} s; it is not used until it has stayed there for {STAYS} s"
        )
        if self.doubt is None or time < self.doubt.until or _far(self.doubt.until, self.doubt.pose, time, pose):
            self.doubt = Doubt(time, time, pose, text)
            return False
        self.doubt = Doubt(self.doubt.since, time, pose, self.doubt.text)
        if time - self.doubt.since < STAYS:
            return False
        self._last, self.doubt = (time, pose), None
        return True


def _far(before: float, T_before: np.ndarray, now: float, T_now: np.ndarray) -> bool:
    distance, angle = transforms.distance(T_before, T_now)
    passed = min(max(0.0, now - before), LONGEST)
    return bool(distance > JUMP + SPEED * passed or angle > TURN + TURN_SPEED * passed)
