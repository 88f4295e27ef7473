"""The planned time of a plan that is followed, in one stretch of it."""

from collections.abc import Callable

from hmap_core.execution.stretches import Stretch
from hmap_core.types import Plan


class StretchClock:
    """Tells the planned time that the controllers are at."""

    def __init__(self, plan: Plan, stretch: Stretch, into: Callable[[], float] = lambda: 0.0):
        """
        Args:
            plan: that is followed.
            stretch: of the plan.
            into: seconds into the stretch by now.
        """
        self._first = float(plan.trajectory.time[stretch.first])
        self._last = float(plan.trajectory.time[stretch.last])
        self._into = into

    def now(self) -> float:
        """The planned time (s) by now."""
        return min(self._first + self._into(), self._last)
