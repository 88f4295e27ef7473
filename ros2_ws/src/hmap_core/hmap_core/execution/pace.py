"""How fast arms may move at the moment: set from outside while a plan is executed."""

import math
import threading
from collections.abc import Callable

from hmap_core.exceptions import InputError


class Pace:
    """Scales speed and acceleration of all motions, and pauses them; may be changed from any thread.

    A motion that runs at a rate r of its planned speed has r^2 of its planned accelerations. So the rate is the smaller
    one of the speed's scale and the square root of the acceleration's.

    Attributes:
        speed: scale of planned speeds, in (0, 1].
        acceleration: scale of planned accelerations, and of the limits within which arms brake, in (0, 1].
        paused: whether everything shall stand.
    """

    def __init__(self, speed: float = 1.0, acceleration: float = 1.0):
        """
        Args:
            speed: scale of planned speeds, in (0, 1].
            acceleration: scale of planned accelerations, in (0, 1].

        Raises:
            InputError: a scale is out of its range.
        """
        self.speed, self.acceleration = scale("speed_scaling", speed), scale("acceleration_scaling", acceleration)
        self._paused = threading.Event()
        self._listeners: list[Callable[[], None]] = []

    @property
    def paused(self) -> bool:
        """Whether everything shall stand."""
        return self._paused.is_set()

    @property
    def rate(self) -> float:
        """Of planned time per second: 0 while paused, 1 at full speed."""
        return 0.0 if self.paused else min(self.speed, math.sqrt(self.acceleration))

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call a function, which must not wait, at every change."""
        self._listeners.append(listener)

    def set_speed(self, value: float) -> None:
        """Scale the speed.

        Raises:
            InputError: the scale is not in (0, 1]; nothing changes.
        """
        self.speed = scale("speed_scaling", value)
        self._tell()

    def set_acceleration(self, value: float) -> None:
        """Scale the acceleration.

        Raises:
            InputError: the scale is not in (0, 1]; nothing changes.
        """
        self.acceleration = scale("acceleration_scaling", value)
        self._tell()

    def pause(self) -> None:
        """Bring all arms to rest along their paths, and keep them there."""
        self._paused.set()
        self._tell()

    def resume(self) -> None:
        """Go on after a pause."""
        self._paused.clear()
        self._tell()

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()


def scale(name: str, value: float) -> float:
    """A scale in (0, 1].

    Raises:
        InputError: it is not.
    """
    if not 0.0 < value <= 1.0:
        raise InputError(f"{name} = {value}: it has to be above 0 and at most 1")
    return float(value)
