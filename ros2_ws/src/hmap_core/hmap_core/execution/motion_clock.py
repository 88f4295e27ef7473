"""Where controllers are in the motions that they follow, from their feedback."""

from collections.abc import Mapping

import numpy as np

from hmap_core.execution.ports import ClockPort, Command
from hmap_core.execution.warp import Warp
from hmap_core.types import JointTrajectory

LEAST_RATE, MOST_RATE = 0.05, 50.0  # s of the controller's clock per s of the executor's that are believed
LEAST_SPAN = 0.05  # s between two reports from which the rate is computed


class MotionClock:
    """Tracks commands that run together.

    Attributes:
        warp: seconds into the motions over seconds of the controllers' clock since ``start``.
        start: s of the controllers' clock; None before the first feedback.
        rate: s of the controllers' clock per s of the executor's.
        end: s, planned, of the longest motion.
    """

    def __init__(
        self,
        motions: Mapping[str, JointTrajectory],
        commands: Mapping[str, Command],
        clock: ClockPort,
        warp: Warp,
        start: float | None = None,
    ):
        """
        Args:
            motions: robot -> its motion, with the planned times.
            commands: robot -> the command along it.
            clock: the executor's.
            warp: at which the motions run.
            start: where the commands were sent with one; else it is found out.
        """
        self.warp, self.start, self.rate = warp, start, 1.0
        self._motions, self._commands, self._clock = motions, commands, clock
        self._told = start is not None
        self._newest: tuple[float, float] | None = None  # stamp and arrival, s, of the newest feedback
        self.end = max((float(motion.times[-1]) for motion in motions.values()), default=0.0)

    def at(self) -> float | None:
        """Seconds of the controllers' clock since the start, by now; None before the first feedback."""
        reports = {robot: command.feedback for robot, command in self._commands.items() if command.feedback}
        if reports:
            robot, feedback = max(reports.items(), key=lambda item: item[1][-1].arrived)
            newest = feedback[-1]
            span = newest.arrived - feedback[0].arrived
            if span >= LEAST_SPAN:
                self.rate = float(np.clip((newest.stamp - feedback[0].stamp) / span, LEAST_RATE, MOST_RATE))
            self._newest = newest.stamp, newest.arrived
            if not self._told:
                into = time_of(self._motions[robot], newest.positions)
                self.start = newest.stamp - self.warp.clock(into)
        if self._newest is None or self.start is None:
            return None
        stamp, arrived = self._newest
        return stamp - self.start + self.rate * (self._clock.now() - arrived)

    def into(self) -> float:
        """Seconds into the motions by now; 0 before the first feedback."""
        at = self.at()
        return 0.0 if at is None else min(max(0.0, float(self.warp.into(at))), self.end)

    def replaced(self, warp: Warp) -> None:
        """The commands were replaced by others with the same start."""
        self.warp, self._told = warp, True


def time_of(motion: JointTrajectory, q: np.ndarray) -> float:
    """Seconds into a motion at which it is nearest to joint positions q (n,)."""
    positions = np.asarray(motion.positions)
    a, b = positions[:-1], positions[1:]
    way = b - a
    square = np.maximum((way**2).sum(axis=1), 1e-18)
    s = (((q - a) * way).sum(axis=1) / square).clip(0.0, 1.0)
    off = np.linalg.norm(a + s[:, None] * way - q, axis=1)
    k = int(off.argmin())
    return float(motion.times[k] + s[k] * (motion.times[k + 1] - motion.times[k]))
