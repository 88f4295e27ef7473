"""The newest measurement of each source: the rules for stamps, in one place and without ROS.

* A stamp that is ahead of the receiver's clock by more than a tolerance is refused.
* A measurement with an older stamp never replaces one with a newer stamp, whenever it arrives.
* When the receiver's clock jumps back, as it does when a simulation is started anew, earlier measurements are dropped.
"""

import bisect
import math
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from hmap_msgs_py.checks import ConversionError

CLOCK_STEP = 0.1  # s; a clock that goes back by more than this was set back or started anew

T = TypeVar("T")


class StampError(ConversionError):
    """A stamp that cannot be right."""


class ReceiverClock:
    """The clock against which stamps are judged.

    Args:
        read: returns the time in s, or None while it is unknown. Without a function the time is always unknown.
        ahead: s that a stamp may be ahead of the clock: clocks of two machines differ, and ``/clock`` can come late.

    Attributes:
        ahead: s, as given.
        reading: the last time that was read, s; None before the first.
        restarts: how often the clock has jumped back.
    """

    def __init__(self, read: Callable[[], float | None] | None = None, ahead: float = math.inf):
        self._read, self.ahead = read, ahead
        self._lock = threading.Lock()
        self.reading: float | None = None
        self.restarts = 0

    def now(self) -> float | None:
        """The time in s; None while it is unknown."""
        with self._lock:
            now = None if self._read is None else self._read()
            if now is not None:
                if self.reading is not None and now < self.reading - CLOCK_STEP:
                    self.restarts += 1
                self.reading = now
            return now

    def check(self, name: str, stamp: float) -> None:
        """Check the stamp (s) of a measurement that has just arrived.

        Args:
            name: of the measurement, for the error.
            stamp: s.

        Raises:
            StampError: the stamp is not finite, or ahead of the clock by more than the tolerance.
        """
        if not math.isfinite(stamp):
            raise StampError(f"{name} has the stamp {stamp}; it must be finite")
        now = self.now()
        if now is not None and stamp > now + self.ahead:
            raise StampError(
                f"{name} is stamped {stamp - now:.2f} s ahead of the clock; at most {self.ahead:g} s are allowed. "
                "Are the clocks of sender and receiver synchronised?"
            )


class Latest(Generic[T]):
    """The measurements of one source, in the order of their stamps. Not safe for threads.

    Args:
        name: of the source, for errors.
        clock: the receiver's clock; None: stamps are only compared with each other.
        kept: number of measurements that are kept.
    """

    def __init__(self, name: str, clock: ReceiverClock | None = None, kept: int = 1):
        self._name, self._clock, self._kept = name, clock or ReceiverClock(), kept
        self._restarts = self._clock.restarts
        self._entries: list[tuple[float, T]] = []
        self._late: tuple[float, T] | None = None  # an older stamp that came last: the first one after a restart

    def add(self, stamp: float, value: T) -> bool:
        """Add a measurement.

        Args:
            stamp: s.
            value: what was measured.

        Returns:
            Whether it is the newest now; false for an older stamp, which replaces nothing.

        Raises:
            StampError: the stamp cannot be right.
        """
        self._clock.check(self._name, stamp)
        return self.add_checked(stamp, value)

    def add_checked(self, stamp: float, value: T) -> bool:
        """As :meth:`add`, for one of many values with a stamp that :meth:`ReceiverClock.check` has accepted."""
        self._follow_clock()
        if self._entries and stamp < self._entries[-1][0]:
            self._late = stamp, value
            if self._kept > 1:
                bisect.insort(self._entries, (stamp, value), key=_stamp)
                del self._entries[: -self._kept]
            return False
        self._late = None
        self._entries.append((stamp, value))
        del self._entries[: -self._kept]
        return True

    def newest(self) -> tuple[float, T] | None:
        """The newest stamp (s) and value, as of the last reading of the clock; None without a measurement."""
        self._follow_clock()
        return self._entries[-1] if self._entries else None

    def nearest(self, stamp: float) -> T | None:
        """The value measured nearest to a time (s); None without a measurement."""
        self._follow_clock()
        return min(self._entries, key=lambda entry: abs(entry[0] - stamp))[1] if self._entries else None

    def within(self, period: float) -> list[T]:
        """The values of the last ``period`` (s) before the newest one, in the order of their stamps."""
        self._follow_clock()
        if not self._entries:
            return []
        since = self._entries[-1][0] - period
        return [value for _, value in self._entries[bisect.bisect_left(self._entries, since, key=_stamp) :]]

    def clear(self) -> None:
        """Drop all measurements."""
        self._entries, self._late = [], None

    def copy_from(self, other: "Latest[T]") -> None:
        """Take over the measurements of another keeper of the same source."""
        self._entries, self._late, self._restarts = list(other._entries), other._late, other._restarts

    def _follow_clock(self) -> None:
        """Drop what was measured before the clock jumped back, and what is ahead of a clock that was unknown before."""
        if self._restarts != self._clock.restarts:
            self._restarts = self._clock.restarts
            self._entries = [] if self._late is None else [self._late]
            self._late = None
        now = self._clock.reading
        if now is not None and self._entries and self._entries[-1][0] > now + self._clock.ahead:
            self._entries = [entry for entry in self._entries if entry[0] <= now + self._clock.ahead]


def _stamp(entry: tuple[float, T]) -> float:
    return entry[0]
