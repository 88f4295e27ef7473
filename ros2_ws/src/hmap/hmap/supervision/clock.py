"""Where in a stretch a controller is: from what it says of its joints, for who is about to replace its trajectory."""

import time

import numpy as np

from hmap.supervision.controllers import Command
from hmap_core.execution.stretches import Stretch, joint_trajectory
from hmap_core.types import Plan

LEAST_RATE, MOST_RATE = 0.05, 50.0  # s of the controller's clock per s that are believed
LEAST_SPAN = 0.05  # s between two reports that tell the rate


class StretchClock:
    """Follows the commands of one stretch.

    Attributes:
        start: when the stretch began, s of the controllers' clock; None as long as nobody has said anything.
        rate: s of the controllers' clock per s.
    """

    def __init__(self, plan: Plan, stretch: Stretch, commands: dict[str, Command]):
        self._plan, self._stretch, self._commands = plan, stretch, commands
        self._first = float(plan.trajectory.time[stretch.first])
        self._last = float(plan.trajectory.time[stretch.last])
        self.start: float | None = None
        self.rate = 1.0

    def now(self) -> float:
        """The planned time (s) that the controllers are at by now; the stretch's begin as long as they are silent."""
        reports = {robot: command.feedback for robot, command in self._commands.items() if command.feedback}
        if not reports:
            return self._first
        robot, feedback = max(reports.items(), key=lambda item: item[1][-1].arrived)
        newest = feedback[-1]
        span = newest.arrived - feedback[0].arrived
        if span >= LEAST_SPAN:
            self.rate = float(np.clip((newest.stamp - feedback[0].stamp) / span, LEAST_RATE, MOST_RATE))
        into = self._place(robot, newest.positions)
        self.start = newest.stamp - into
        now = self._first + into + self.rate * (time.monotonic() - newest.arrived)
        return min(now, self._last)

    def _place(self, robot: str, q: np.ndarray) -> float:
        """Seconds into the stretch at which its motion is nearest to joint positions q (n,)."""
        motion = joint_trajectory(self._plan, robot, self._stretch)
        a, b = motion.positions[:-1], motion.positions[1:]
        way = b - a
        square = np.maximum((way**2).sum(axis=1), 1e-18)
        s = (((q - a) * way).sum(axis=1) / square).clip(0.0, 1.0)
        off = np.linalg.norm(a + s[:, None] * way - q, axis=1)
        k = int(off.argmin())
        return float(motion.times[k] + s[k] * (motion.times[k + 1] - motion.times[k]))
