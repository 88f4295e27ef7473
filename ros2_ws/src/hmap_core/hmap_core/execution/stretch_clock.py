"""Where in a stretch the controllers are, from their feedback: for who is about to replace their trajectories."""

from collections.abc import Mapping

import numpy as np

from hmap_core.execution.ports import ClockPort, Command
from hmap_core.execution.stretches import Stretch, joint_trajectory
from hmap_core.types import Plan

LEAST_RATE, MOST_RATE = 0.05, 50.0  # s of the controller's clock per s of the executor's that are believed
LEAST_SPAN = 0.05  # s between two reports from which the rate is computed


class StretchClock:
    """Tracks the commands of one stretch.

    Attributes:
        start: when the stretch began, s of the controllers' clock; None before the first feedback.
        rate: s of the controllers' clock per s of the executor's.
    """

    def __init__(self, plan: Plan, stretch: Stretch, commands: Mapping[str, Command], clock: ClockPort):
        """
        Args:
            plan: that is followed.
            stretch: of the plan.
            commands: robot -> the command along this stretch.
            clock: the executor's.
        """
        self._plan, self._stretch, self._commands, self._clock = plan, stretch, commands, clock
        self._first = float(plan.trajectory.time[stretch.first])
        self._last = float(plan.trajectory.time[stretch.last])
        self.start: float | None = None
        self.rate = 1.0

    def now(self) -> float:
        """The planned time (s) that the controllers are at by now; before the first feedback the stretch's begin."""
        reports = {robot: command.feedback for robot, command in self._commands.items() if command.feedback}
        if not reports:
            return self._first
        robot, feedback = max(reports.items(), key=lambda item: item[1][-1].arrived)
        newest = feedback[-1]
        span = newest.arrived - feedback[0].arrived
        if span >= LEAST_SPAN:
            self.rate = float(np.clip((newest.stamp - feedback[0].stamp) / span, LEAST_RATE, MOST_RATE))
        into = self._time_of(robot, newest.positions)
        self.start = newest.stamp - into
        now = self._first + into + self.rate * (self._clock.now() - newest.arrived)
        return min(now, self._last)

    def _time_of(self, robot: str, q: np.ndarray) -> float:
        """Seconds into the stretch at which its motion is nearest to joint positions q (n,)."""
        motion = joint_trajectory(self._plan, robot, self._stretch)
        a, b = motion.positions[:-1], motion.positions[1:]
        way = b - a
        square = np.maximum((way**2).sum(axis=1), 1e-18)
        s = (((q - a) * way).sum(axis=1) / square).clip(0.0, 1.0)
        off = np.linalg.norm(a + s[:, None] * way - q, axis=1)
        k = int(off.argmin())
        return float(motion.times[k] + s[k] * (motion.times[k + 1] - motion.times[k]))
