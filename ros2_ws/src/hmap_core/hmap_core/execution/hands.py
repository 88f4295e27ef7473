"""Arms and grippers during an execution: what they were commanded, what they hold, and how hands become free."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.moving import Moving, wait_while_paused
from hmap_core.execution.pace import Pace
from hmap_core.execution.ports import Canceled, Command, Ports
from hmap_core.execution.stretches import Stretch
from hmap_core.trajectory.measured import without_noise
from hmap_core.trajectory.samples import state_at
from hmap_core.types import JointTrajectory, Plan, Robot, SceneState

OPENING_CHANGE = 1e-4  # m; a smaller change of the opening needs no command
EMPTY = 0.005  # m that the fingers may close beyond the planned opening when they grip something
GRIP_LIMIT = 30.0  # s for a gripper


class Hands:
    """What arms and grippers were commanded, across the plans of an execution.

    Attributes:
        held: robot -> the body that it grips.
    """

    def __init__(self, ports: Ports, canceled: Canceled, pace: Pace | None = None):
        """
        Args:
            ports: to the controllers and the world.
            canceled: true stops every motion.
            pace: of all motions; None: as planned.
        """
        self._pace = pace or Pace()
        self.held: dict[str, str] = {}
        self._ports, self._canceled = ports, canceled
        self._commanded: dict[str, np.ndarray] = {}  # robot -> the end (n,) of its last motion
        self._openings: dict[str, float] = {}  # robot -> the opening (m) that its gripper was sent to
        self._closed: set[str] = set()  # robots whose grippers were closed on something

    def start_state(self, plan: Plan, sample: int) -> SceneState:
        """The state at rest from which a new motion starts without a jump.

        Bodies, joints and fingers that are at a planned or commanded value but for noise have that value.

        Args:
            plan: that was followed.
            sample: of the plan, up to which it was followed.

        Raises:
            InputError: STALE_STATE; there is no state.
        """
        measured, planned = self._ports.observation.settled(), state_at(plan, sample)
        planned.q.update({robot: q for robot, q in self._commanded.items() if robot in planned.q})
        return without_noise(self._ports.scene(), measured, planned)

    def start(self, robots: Mapping[str, Robot], motions: Mapping[str, JointTrajectory]) -> Moving:
        """Start to move arms along motions (by robot), all at once; exceptions as of :class:`Moving`."""
        held = bool(self.held.keys() & motions.keys())
        return Moving(self._ports, self._canceled, self._pace, robots, motions, held, self._commanded)

    def move(self, robot: Robot, motion: JointTrajectory | None) -> None:
        """Move an arm along a motion and wait for its end; None: nothing to do.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST.
        """
        if motion is not None:
            self.start({robot.name: robot}, {robot.name: motion}).follow()

    def wait(self, commands: Sequence[Command], limit: float, look: Callable[[], None] | None = None) -> None:
        """Wait until commands have ended; arguments and exceptions as in :meth:`ControllerPort.wait`."""
        self._ports.controllers.wait(commands, limit, self._canceled, look)

    def open(self, robot: Robot, opening: float | None = None) -> None:
        """Open a gripper to an opening (m), or as far as it goes, and wait for it.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST.
        """
        gripper = robot.model.gripper
        if gripper is not None:
            wait_while_paused(self._ports, self._canceled, self._pace)
            opening = gripper.open_opening if opening is None else opening
            self.wait([self._ports.controllers.grip(robot, opening, gripper.force)], GRIP_LIMIT)
            self._openings[robot.name] = opening
        self.held.pop(robot.name, None)
        self._closed.discard(robot.name)

    def let_go(self, plan: Plan) -> None:
        """Open every gripper that was closed on something.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST.
        """
        for robot in sorted(self._closed | set(self.held)):
            self.open(plan.scene.robots[robot])

    def grip(self, plan: Plan, stretch: Stretch, look: Callable[[], None]) -> None:
        """Close on what is held in a stretch, then open as planned what is not, and wait until the fingers stand.

        What one robot passes to another one is let go once the second gripper holds it.

        Args:
            plan: that is followed.
            stretch: that begins.
            look: called while waiting.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST; OBJECT_DROPPED, a gripper closed on nothing.
        """
        wait_while_paused(self._ports, self._canceled, self._pace, look)
        self._close(plan, stretch, look)
        self._let_others_go(plan, stretch, look)

    def _close(self, plan: Plan, stretch: Stretch, look: Callable[[], None]) -> None:
        """Close on what is held in a stretch and was not before, and make sure that it is between the fingers."""
        commands = {}
        for name, body in stretch.held.items():
            robot = plan.scene.robots[name]
            if self.held.get(name) != body:
                gripper = robot.model.require_gripper()
                commands[name] = self._ports.controllers.grip(robot, gripper.min_opening, gripper.force)
                self._closed.add(name)
                self._openings.pop(name, None)
        self.wait(list(commands.values()), GRIP_LIMIT, look)
        for name, command in commands.items():
            self._check_grip(plan, stretch, name, command.opening)
            self.held[name] = stretch.held[name]

    def _let_others_go(self, plan: Plan, stretch: Stretch, look: Callable[[], None]) -> None:
        """Bring the grippers that hold nothing in a stretch to their planned openings."""
        commands = []
        for name, robot in plan.scene.robots.items():
            gripper = robot.model.gripper
            if gripper is None or name in stretch.held:
                continue
            opening = float(plan.trajectory.gripper[name][stretch.last])
            if abs(self._openings.get(name, np.inf) - opening) > OPENING_CHANGE:
                commands.append(self._ports.controllers.grip(robot, opening, gripper.force))
                self._openings[name] = opening
        self.held = {name: body for name, body in self.held.items() if stretch.held.get(name) == body}
        self.wait(commands, GRIP_LIMIT, look)
        self._closed &= set(stretch.held)

    def _check_grip(self, plan: Plan, stretch: Stretch, robot: str, opening: float) -> None:
        """By touch where there are sensors, else by how far the fingers closed."""
        body, planned = stretch.held[robot], float(plan.trajectory.gripper[robot][stretch.first])
        grasped = self._ports.observation.grasped(robot, body)
        if grasped is None:
            grasped = opening >= planned - EMPTY
        if not grasped:
            raise ExecutionError(
                f"the gripper of '{robot}' closed to {opening:.3f} m at {plan.trajectory.time[stretch.first]:.2f} s "
                f"without '{body}' between its fingers; {planned:.3f} m were planned",
                Code.OBJECT_DROPPED,
            )
