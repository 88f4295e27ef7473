"""Execute a plan with simulated robots under dynamics, and say whether it solved its task.

The plan is followed stretch by stretch (see :mod:`hmap_core.execution.stretches`), through the same controllers that a
robot would have: nothing but the joints and the fingers is ever commanded. :class:`Execution` can be driven from
outside one stretch at a time, with :meth:`Execution.observe` between them, by someone who plans again in the middle.
"""

from collections.abc import Callable, Mapping

import numpy as np

from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.report import Deviation, ExecutionReport
from hmap_core.execution.stretches import Stretch, check_executable, joint_trajectory, stretches
from hmap_core.execution.watcher import MOVED_LIMIT, WATCH_PERIOD, Watcher, deviation
from hmap_core.simulation.controllers import GripperController, Outcome, TrajectoryController
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Plan, SceneState

START_SETTLE = 0.2  # s for the bodies to come to rest before anything moves
END_SETTLE = 2.0  # s at most for them to come to rest after it
REST_VELOCITY = 0.002  # m/s and rad/s; slower counts as at rest
GRIPPER_WAIT = 1.5  # s at most for the fingers to close or open before the arm moves on
GRIP_TIME = 0.1  # s more for all of them to touch what they hold

LOST = (Outcome.PATH_TOLERANCE_VIOLATED, Outcome.GOAL_TOLERANCE_VIOLATED)

Progress = Callable[[float, float, str], None]  # planned time now and at the end (s), what is being done


def execute(plan: Plan, on_progress: Progress | None = None) -> ExecutionReport:
    """Execute a plan from its scene's start to its end, in a simulation of its own.

    The same plan gives the same report.

    Raises:
        InputError: the plan is kinematic, or inconsistent with its scene.
    """
    with Execution(plan) as execution:
        try:
            for stretch in execution.stretches:
                if on_progress:
                    time = plan.trajectory.time
                    on_progress(float(time[stretch.first]), float(time[-1]), stretch.label)
                execution.follow(stretch)
        except ExecutionError as failure:
            return execution.report(failure)
        return execution.report()


class Execution:
    """A plan being executed.

    Attributes:
        plan: what is executed.
        stretches: its pieces, to be followed in order.
        world: the simulation.
    """

    def __init__(self, plan: Plan, world: SimulatedWorld | None = None, places: Mapping[str, np.ndarray] | None = None):
        """Set the scene up, or go on in a world in which everything is where the plan begins.

        Args:
            world: one to go on in, which stays open afterwards; None: a new one.
            places: body -> the pose (7,) from which its motion counts where the plan leaves it alone; None: where the
                plan begins.

        Raises:
            InputError: the plan is kinematic, or inconsistent with its scene.
        """
        check_executable(plan)
        self.plan = plan
        self.stretches = stretches(plan)
        self._lasting = world is not None
        self.world = world or SimulatedWorld(plan.scene)
        self._arms = {
            name: TrajectoryController(robot.model.joint_names, robot.q, robot.model.acceleration_limits)
            for name, robot in plan.scene.robots.items()
        }
        self._grippers = {
            name: GripperController(robot.model.gripper, plan.trajectory.gripper[name][0])
            for name, robot in plan.scene.robots.items()
            if robot.model.gripper
        }
        self._watcher = Watcher(plan, self.world, places)
        self._held: dict[str, str] = {}
        self._tracking_error = 0.0

    def __enter__(self) -> "Execution":
        return self

    def __exit__(self, *_) -> None:
        if not self._lasting:
            self.world.close()

    @property
    def fell(self) -> tuple[str, ...]:
        """Bodies that have fallen or toppled so far."""
        return tuple(self._watcher.fell)

    def observe(self) -> SceneState:
        """Where everything really is."""
        return self.world.state()

    def follow(self, stretch: Stretch) -> None:
        """Execute one stretch: grip or let go, then move.

        Raises:
            ExecutionError: a joint is blocked, a gripper closes on nothing, or something is lost or falls.
        """
        if self.world.time == 0.0:
            self._pass(START_SETTLE, stretch.first)
        self._move_grippers(stretch)
        self._watcher.mark(stretch.first)
        time = self.plan.trajectory.time
        started = self.world.time
        for name, arm in self._arms.items():
            arm.start(joint_trajectory(self.plan, name, stretch), started)
        while any(arm.active for arm in self._arms.values()):
            t = time[stretch.first] + self.world.time - started
            self._command_grippers(stretch, min(t, time[stretch.last]))
            self._step(min(index_at(time, t), stretch.last))
            self._check_tracking(t)
        self._watcher.mark(stretch.last)

    def settle(self, sample: int) -> None:
        """Let the bodies come to rest, for END_SETTLE at most; ``sample`` is where the plan is meanwhile.

        Raises:
            ExecutionError: a body falls.
        """
        until = self.world.time + END_SETTLE
        self._pass(WATCH_PERIOD, sample)
        while self.world.time < until and self._watcher.fastest() > REST_VELOCITY:
            self._pass(WATCH_PERIOD, sample)

    def let_go(self, stretch: Stretch) -> None:
        """In the middle of a stretch: stop the arms, open the grippers that hold something, let all come to rest.

        Raises:
            ExecutionError: a body falls.
        """
        self._stop()
        for robot in stretch.held:
            self._grippers[robot].start(self.plan.scene.robots[robot].model.gripper.open_opening)
        started = self.world.time
        while self._moving() and self.world.time - started < GRIPPER_WAIT:
            self._step(stretch.last)
        self.settle(stretch.last)

    def report(self, failure: ExecutionError | None = None) -> ExecutionReport:
        """Stop, let everything come to rest, and judge the outcome."""
        self._stop()
        end = len(self.plan.trajectory.time) - 1
        try:
            self.settle(end)
        except ExecutionError as late:
            failure = failure or late
        goal = self.plan.scene.goal
        error = deviation(goal.pose, self.world.body_pose(goal.object))
        code, reason = self._verdict(error, failure)
        return ExecutionReport(
            solved=code is Code.SUCCESS,
            goal_error=error,
            code=code,
            reason=reason,
            drift=self._watcher.drift(),
            fell=tuple(self._watcher.fell),
            moved=tuple(self._watcher.moved),
            tracking_error_max=self._tracking_error,
            duration=self.world.time,
        )

    def _verdict(self, error: Deviation, failure: ExecutionError | None) -> tuple[Code, str]:
        if failure is not None:
            return failure.code, failure.reason
        for name, distance in self._watcher.moved.items():
            return Code.GOAL_MISSED, f"'{name}' should stay and moved by {distance:.3f} m; {MOVED_LIMIT} m are allowed"
        distance, angle = self.plan.scene.execution_tolerance
        if not (error.position_m <= distance and error.rotation_deg <= np.rad2deg(angle)):  # nor when not a number
            return Code.GOAL_MISSED, (
                f"'{self.plan.scene.goal.object}' ends {error.position_m:.3f} m and {error.rotation_deg:.1f} deg from "
                f"its goal; {distance:.3f} m and {np.rad2deg(angle):.1f} deg are allowed"
            )
        return Code.SUCCESS, ""

    def _move_grippers(self, stretch: Stretch) -> None:
        """Give the grippers their command for the start of the stretch and wait for those that have to move."""
        self._held = {}
        for name, gripper in self._grippers.items():
            gripper.start(*self._gripper_command(name, stretch, self.plan.trajectory.time[stretch.first]))
        started = self.world.time
        while any(g.active for g in self._grippers.values()) and self.world.time - started < GRIPPER_WAIT:
            self._step(stretch.first)
        for robot, body in stretch.held.items():
            self._check_grip(robot, body, stretch.first)
        self._held = dict(stretch.held)

    def _check_grip(self, robot: str, body: str, sample: int) -> None:
        """Make sure that every finger touches the body, given a moment to do so."""
        until = self.world.time + GRIP_TIME
        while not self._watcher.touches_fingers(robot, body, every_finger=True):
            if self.world.time > until:
                opening, t = self.world.robot(robot).gripper_state()[0], self.plan.trajectory.time[sample]
                raise ExecutionError(
                    f"the gripper of '{robot}' closed to {opening:.3f} m at {t:.2f} s without '{body}' between its "
                    "fingers",
                    Code.OBJECT_DROPPED,
                )
            self._step(sample)

    def _command_grippers(self, stretch: Stretch, t: float) -> None:
        for name, gripper in self._grippers.items():
            if name not in stretch.held:
                gripper.start(*self._gripper_command(name, stretch, t))

    def _gripper_command(self, robot: str, stretch: Stretch, t: float) -> tuple[float, float]:
        """Opening (m) and force (N): closing on what is held, else as planned."""
        gripper = self.plan.scene.robots[robot].model.gripper
        if robot in stretch.held:
            return gripper.min_opening, gripper.force
        trajectory = self.plan.trajectory
        return float(np.interp(t, trajectory.time, trajectory.gripper[robot])), gripper.force

    def _step(self, sample: int) -> None:
        """Update every controller, let one time step pass, and look at the bodies now and then."""
        now = self.world.time
        for name, arm in self._arms.items():
            robot = self.world.robot(name)
            desired = arm.update(now, *robot.arm_state())
            robot.set_joint_targets(desired.q, desired.qd)
            self._tracking_error = max(self._tracking_error, float(np.abs(desired.error).max()))
        for name, gripper in self._grippers.items():
            robot = self.world.robot(name)
            robot.set_gripper(*gripper.update(now, *robot.gripper_state()))
        self.world.step()
        self._watcher.look(sample, self._held)

    def _check_tracking(self, t: float) -> None:
        for name, arm in self._arms.items():
            if arm.outcome in LOST:
                raise ExecutionError(f"robot '{name}' at {t:.2f} s: {arm.reason}", Code.TRACKING_LOST)

    def _pass(self, seconds: float, sample: int) -> None:
        until = self.world.time + seconds
        while self.world.time < until:
            self._step(sample)

    def _stop(self) -> None:
        for arm in self._arms.values():
            arm.cancel(self.world.time)
        self._held = {}

    def _moving(self) -> bool:
        """Whether an arm or a gripper is still told to move."""
        return any(arm.moving for arm in self._arms.values()) or any(g.active for g in self._grippers.values())
