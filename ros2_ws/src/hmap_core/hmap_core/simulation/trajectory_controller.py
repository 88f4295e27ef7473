"""Follows joint trajectories, as ros2_control's joint_trajectory_controller does behind FollowJointTrajectory."""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.execution.outcome import Outcome
from hmap_core.simulation.motions import Follow, Stop
from hmap_core.types import JointTrajectory

PATH_TOLERANCE = 0.1  # rad; farther behind while moving, a joint is taken to be blocked
GOAL_TOLERANCE = 0.01  # rad
STOPPED_VELOCITY = 0.02  # rad/s; slower counts as standing
GOAL_TIME_TOLERANCE = 1.0  # s after the end of a trajectory for the joints to arrive
LEAST_TIME = 0.002  # s from now; points of a trajectory that is taken up in its middle come no sooner
START_TOLERANCE = 0.02  # rad between a trajectory's start and where the joints are told to be


@dataclass(frozen=True)
class Tolerances:
    """What is accepted of the joints, per joint (n,) or one number for all; see the constants of this module."""

    path: float | np.ndarray = PATH_TOLERANCE
    goal: float | np.ndarray = GOAL_TOLERANCE
    stopped_velocity: float = STOPPED_VELOCITY
    goal_time: float = GOAL_TIME_TOLERANCE
    start: float = START_TOLERANCE


@dataclass(frozen=True)
class Tracking:
    """Desired and actual motion of the controller's joints, (n,) each; errors are desired minus actual.

    Attributes:
        q, qd: desired positions and velocities.
        q_actual, qd_actual: measured ones.
        effort: desired efforts beside those that follow the motion, N m; None: none.
    """

    q: np.ndarray
    qd: np.ndarray
    q_actual: np.ndarray
    qd_actual: np.ndarray
    effort: np.ndarray | None = None

    @property
    def error(self) -> np.ndarray:
        """Desired minus actual positions (n,), rad."""
        return self.q - self.q_actual


def from_instant(trajectory: JointTrajectory, start: float, now: float) -> JointTrajectory:
    """What is left at ``now`` (s) of a trajectory whose times count from ``start`` (s), its times counted from now.

    As ros2_control's controller does with the stamp in a trajectory's header: points in the past are left out, and the
    joints go from where they are told to be to the first that is left. A start in the future is waited for likewise.

    Raises:
        InputError: all of it is in the past.
    """
    times = np.asarray(trajectory.times, float) + (start - now)
    left = times > LEAST_TIME
    if not left.any():
        raise InputError(f"the trajectory ended {now - start - float(trajectory.times[-1]):.3f} s ago")
    velocities = None if trajectory.velocities is None else np.asarray(trajectory.velocities)[left]
    efforts = None if trajectory.efforts is None else np.asarray(trajectory.efforts)[left]
    positions = np.asarray(trajectory.positions)[left]
    return replace(trajectory, times=times[left], positions=positions, velocities=velocities, efforts=efforts)


class StartsElsewhere(InputError):
    """The joints are not where a trajectory starts."""


class TrajectoryController:
    """Follows one joint trajectory at a time; holds still between them.

    Attributes:
        outcome: of the last trajectory, or None before the first.
        reason: a sentence on the outcome where it is not a success; empty otherwise.
        tracking: desired and actual motion at the last update.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        q: np.ndarray,
        acceleration_limits: np.ndarray,
        tolerances: Tolerances | None = None,
    ):
        """
        Args:
            names: the n joints.
            q: (n,) where they are, and are held.
            acceleration_limits: (n,) rad/s^2, for stopping.
            tolerances: of trajectories that bring none.
        """
        self.names = tuple(names)
        self.outcome: Outcome | None = None
        self.reason = ""
        self._limits = np.asarray(acceleration_limits, float)
        self._default_tolerances = tolerances or Tolerances()
        self._tolerances = self._default_tolerances
        self.hold(q)

    @property
    def active(self) -> bool:
        """Whether a trajectory is being followed."""
        return self.outcome is Outcome.ACTIVE

    @property
    def moving(self) -> bool:
        """Whether the joints are told to move, by a trajectory or in stopping after one."""
        return self.active or bool(self.tracking.qd.any())

    def hold(self, q: np.ndarray) -> None:
        """Forget any motion and hold the joints at ``q`` (n,), where the caller knows them to be."""
        q = np.array(q, float)
        still = np.zeros_like(q)
        self._motion: Stop | Follow = Stop(0.0, q, still, self._limits)
        self.tracking = Tracking(q, still, q, still)
        if self.active:
            self._end(Outcome.PREEMPTED, "the controller was told to hold")

    def start(self, trajectory: JointTrajectory, now: float, tolerances: Tolerances | None = None) -> None:
        """Follow a trajectory from ``now`` (s), in place of any that is active.

        Raises:
            InputError: the trajectory is malformed, or does not end at rest; what was active goes on.
            StartsElsewhere: it starts neither where the joints are told to be nor, at rest, where they are; likewise.
        """
        motion = self._checked(trajectory, now, tolerances or self._default_tolerances)
        if self.active:
            self._end(Outcome.PREEMPTED, "another trajectory took its place")
        self._motion = motion
        self._tolerances = tolerances or self._default_tolerances
        self.outcome, self.reason = Outcome.ACTIVE, ""

    def cancel(self, now: float) -> None:
        """Bring the joints to rest, straight on and within their acceleration limits; no effect when none is active."""
        if self.active:
            q, qd = self._motion.at(now)
            self._motion = Stop(now, q, qd, self._limits)
            self._end(Outcome.CANCELED, "canceled")

    def update(self, now: float, q: np.ndarray, qd: np.ndarray) -> Tracking:
        """Desired motion at ``now`` (s), given the measured positions and velocities (n,).

        Times must not decrease. After a violated tolerance the joints are brought to rest from where they are.
        """
        effort = self._motion.efforts_at(now)
        self.tracking = Tracking(*self._motion.at(now), np.asarray(q, float), np.asarray(qd, float), effort)
        if self.active:
            self._judge(now)
        return self.tracking

    def _judge(self, now: float) -> None:
        late = now - self._motion.end
        error = np.abs(self.tracking.error)
        if late < 0.0:
            self._abort_beyond(self._tolerances.path, error, now, Outcome.PATH_TOLERANCE_VIOLATED)
            return
        standing = np.abs(self.tracking.qd_actual).max() <= self._tolerances.stopped_velocity
        if standing and (error <= self._tolerances.goal).all():
            self._end(Outcome.SUCCEEDED, "")
        elif late > self._tolerances.goal_time:
            # standing short of the goal, or at the goal and not standing
            worst = self._abort_beyond(self._tolerances.goal, error, now, Outcome.GOAL_TOLERANCE_VIOLATED)
            if not worst:
                self._abort(now, Outcome.GOAL_TOLERANCE_VIOLATED, "the joints do not come to rest at the goal")

    def _abort_beyond(self, tolerance, error: np.ndarray, now: float, outcome: Outcome) -> bool:
        excess = error - np.broadcast_to(tolerance, error.shape)
        i = int(np.argmax(excess))
        if excess[i] <= 0.0:
            return False
        allowed = np.broadcast_to(tolerance, error.shape)[i]
        self._abort(now, outcome, f"joint {self.names[i]} is {error[i]:.3f} rad off its path; {allowed:.3f} is allowed")
        return True

    def _abort(self, now: float, outcome: Outcome, reason: str) -> None:
        self._motion = Stop(now, self.tracking.q_actual, self.tracking.qd_actual, self._limits)
        self.tracking = Tracking(*self._motion.at(now), self.tracking.q_actual, self.tracking.qd_actual)
        self._end(outcome, reason)

    def _end(self, outcome: Outcome, reason: str) -> None:
        self.outcome, self.reason = outcome, reason

    def _checked(self, trajectory: JointTrajectory, now: float, tolerances: Tolerances) -> "Follow":
        times, positions, velocities, efforts = self._ordered(trajectory)
        if (np.diff(times) <= 0.0).any() or times[0] < 0.0:
            k = int(np.argmax(np.diff(times) <= 0.0)) + 1 if times[0] >= 0.0 else 0
            raise InputError(f"trajectory times have to increase from 0 on; point {k} is at {times[k]} s")
        if velocities is not None and velocities[-1].any():
            i = int(np.argmax(np.abs(velocities[-1])))
            raise InputError(
                f"a trajectory has to end at rest; joint {self.names[i]} ends at {velocities[-1, i]} rad/s"
            )
        q, qd = self._motion.at(now)
        if times[0] > 0.0:
            times, positions = np.concatenate([[0.0], times]), np.concatenate([q[None], positions])
            velocities = None if velocities is None else np.concatenate([qd[None], velocities])
            efforts = None if efforts is None else np.concatenate([self._motion.efforts_at(now)[None], efforts])
        jump = np.abs(positions[0] - q)
        if not self.moving:  # what pushes against the arm keeps it from where it is told to be
            jump = np.minimum(jump, np.abs(positions[0] - self.tracking.q_actual))
        if jump.max() > tolerances.start:
            i = int(np.argmax(jump))
            raise StartsElsewhere(
                f"the trajectory starts {jump[i]:.3f} rad from where joint {self.names[i]} is; "
                f"{tolerances.start} is allowed"
            )
        return Follow(now, times, positions, velocities, efforts)

    def _ordered(
        self, trajectory: JointTrajectory
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray | None]:
        """Times, positions, velocities and efforts as finite arrays, columns in the controller's order."""
        unknown = sorted(set(trajectory.names) - set(self.names))
        missing = [name for name in self.names if name not in trajectory.names]
        if unknown or missing or len(trajectory.names) != len(self.names):
            raise InputError(
                f"a trajectory names each of {list(self.names)} once; unknown: {unknown}, missing: {missing}"
            )
        times = np.asarray(trajectory.times, float)
        if times.ndim != 1 or len(times) == 0:
            raise InputError("the trajectory has no points")
        shape = (len(times), len(self.names))
        columns = [trajectory.names.index(name) for name in self.names]
        tables = {"times": times, "positions": trajectory.positions}
        if trajectory.velocities is not None:
            tables["velocities"] = trajectory.velocities
        if trajectory.efforts is not None:
            tables["efforts"] = trajectory.efforts
        for name, table in tables.items():
            table = np.asarray(table, float)
            if name != "times" and table.shape != shape:
                raise InputError(f"the {name} of the trajectory have the shape {table.shape}; {shape} is needed")
            if not np.isfinite(table).all():
                k = int(np.argwhere(~np.isfinite(table))[0][0])
                raise InputError(f"the {name} of the trajectory are not finite at point {k}")
            tables[name] = table if name == "times" else table[:, columns]
        return tables["times"], tables["positions"], tables.get("velocities"), tables.get("efforts")
