"""The ports of a plan executor over a simulated world: waiting for controllers lets simulated time pass."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hmap_core.exceptions import Code, ExecutionError, PlannerError
from hmap_core.execution.outcome import Outcome
from hmap_core.execution.ports import Canceled, Command, Feedback, Ports
from hmap_core.simulation.controllers import GripperController, StartsElsewhere, TrajectoryController, from_instant
from hmap_core.simulation.physics_world import PhysicsWorld
from hmap_core.trajectory.samples import movable_bodies
from hmap_core.types import JointTrajectory, Robot, Scene, SceneState

LOOK_PERIOD = 0.02  # s between looks while controllers are waited for
SETTLE_LIMIT = 2.0  # s at most for everything to come to rest
REST_VELOCITY = 0.002  # m/s and rad/s; slower counts as at rest
GRIPPER_WAIT = 1.5  # s at most for the fingers to close or open before the arm moves on
GRIP_TIME = 0.1  # s more for all of them to touch what they grip
STOP_LIMIT = 5.0  # s for an arm to come to rest
SAME_PLACE = 1e-3  # m that a body may move before the scene counts as changed
Controller = TrajectoryController | GripperController
LOST = (Outcome.PATH_TOLERANCE_VIOLATED, Outcome.GOAL_TOLERANCE_VIOLATED)


@dataclass
class SimulatedCommand:
    """A command to a simulated controller.

    Attributes:
        robot: whose controller.
        until: simulated time (s) after which the command is taken to have ended; none for arms.
        outcome: how it ended.
        reason: a sentence where it failed.
        opening: of a gripper at the end, m.
        feedback: the first and the newest; arms only.
    """

    robot: str
    until: float = np.inf
    outcome: Outcome = Outcome.ACTIVE
    reason: str = ""
    opening: float = 0.0
    feedback: tuple[Feedback, ...] = field(default=())

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.outcome is not Outcome.ACTIVE


class SimulatedControllers:
    """Arms and grippers of a simulated world, with the controllers that a robot would have."""

    def __init__(self, world: PhysicsWorld):
        """
        Args:
            world: used by nothing else meanwhile.
        """
        self.world = world
        start = world.state()
        robots = world.scene.robots
        self._arms = {
            name: TrajectoryController(robot.model.joint_names, start.q[name], robot.model.acceleration_limits)
            for name, robot in robots.items()
        }
        self._grippers = {
            name: GripperController(robot.model.gripper, robot.model.gripper.open_opening)
            for name, robot in robots.items()
            if robot.model.gripper
        }
        self._commands: dict[Controller, SimulatedCommand] = {}  # controller -> its command under way
        self._tracking_error = 0.0

    @property
    def tracking_error(self) -> float:
        """Largest deviation of any joint from its commanded position so far, rad."""
        return self._tracking_error

    def move(self, robot: Robot, motion: JointTrajectory, start: float | None = None) -> SimulatedCommand:
        """As :meth:`ControllerPort.move`; the controllers' clock is that of the world.

        Raises:
            InputError: the trajectory is malformed.
            ExecutionError: TRACKING_LOST; the arm is not where it starts.
        """
        now, arm = self.world.time, self._arms[robot.name]
        try:
            arm.start(motion if start is None else from_instant(motion, start, now), now)
        except StartsElsewhere as error:
            raise ExecutionError(f"robot '{robot.name}': {error.reason}", Code.TRACKING_LOST) from error
        return self._begin(arm, SimulatedCommand(robot.name))

    def common_start(self) -> None:
        """None: no time passes between two commands."""

    def grip(self, robot: Robot, opening: float, force: float) -> SimulatedCommand:
        """As :meth:`ControllerPort.grip`; fingers that neither arrive nor stand are waited for a while only."""
        gripper = self._grippers[robot.name]
        gripper.start(opening, force)
        return self._begin(gripper, SimulatedCommand(robot.name, self.world.time + GRIPPER_WAIT))

    def wait(
        self,
        commands: Sequence[Command],
        limit: float,
        canceled: Canceled,
        look: Callable[[], None] | None = None,
    ) -> None:
        """Let time pass until all commands have ended; as :meth:`ControllerPort.wait`.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST; a joint is blocked.
        """
        until, own = self.world.time + limit, [_own(command) for command in commands]
        while not all(command.done for command in own):
            if canceled():
                self._halt(own)
                raise PlannerError("canceled; the motion was stopped", Code.CANCELED)
            if self.world.time > until:
                self._halt(own)
                raise ExecutionError(f"no controller finished within {limit:g} s", Code.TRACKING_LOST)
            if look is not None:
                look()
            self.pass_time(LOOK_PERIOD, lambda: all(command.done or command.reason for command in own))
            self._raise_failure(own)
        self._raise_failure(own)

    def stop(self) -> None:
        """Bring all arms to rest and wait for that."""
        for arm in self._arms.values():
            arm.cancel(self.world.time)
        self._rest()

    def pass_time(self, seconds: float, ended: Callable[[], bool] = lambda: False) -> None:
        """Let time pass, with all controllers at work.

        Args:
            seconds: how long at most.
            ended: asked after every step; true ends the time sooner.
        """
        until = self.world.time + seconds
        while self.world.time < until:
            self._step()
            if ended():
                return

    def _begin(self, controller: Controller, command: SimulatedCommand) -> SimulatedCommand:
        before = self._commands.get(controller)
        if before is not None and not before.done:
            before.outcome = Outcome.PREEMPTED
        self._commands[controller] = command
        return command

    def _raise_failure(self, commands: Sequence[SimulatedCommand]) -> None:
        failed = next((command for command in commands if command.outcome in LOST), None)
        if failed is not None:
            self._halt(commands)
            raise ExecutionError(f"robot '{failed.robot}': {failed.reason}", Code.TRACKING_LOST)

    def _halt(self, commands: Sequence[SimulatedCommand]) -> None:
        for controller, command in self._commands.items():
            if any(command is other for other in commands) and controller.active:
                if isinstance(controller, TrajectoryController):
                    controller.cancel(self.world.time)
                else:
                    controller.cancel()
        self._rest()

    def _rest(self) -> None:
        moving = self._arms.values()
        self.pass_time(STOP_LIMIT, lambda: not any(arm.moving for arm in moving))

    def _step(self) -> None:
        now = self.world.time
        for name, arm in self._arms.items():
            robot = self.world.robot(name)
            desired = arm.update(now, *robot.arm_state())
            robot.set_joint_targets(desired.q, desired.qd, desired.effort)
            self._tracking_error = max(self._tracking_error, float(np.abs(desired.error).max()))
            command = self._commands.get(arm)
            if command is not None and not command.done:
                entry = Feedback(now, now, desired.q)
                command.feedback = (*command.feedback[:1], entry)
                command.outcome, command.reason = arm.outcome or command.outcome, arm.reason
        for name, gripper in self._grippers.items():
            robot = self.world.robot(name)
            robot.set_gripper(*gripper.update(now, *robot.gripper_state()))
            command = self._commands.get(gripper)
            if command is not None and not command.done:
                command.outcome, command.opening = gripper.outcome or command.outcome, gripper.result.opening
                if not command.done and now >= command.until:
                    command.outcome = Outcome.STALLED
        self.world.step()


class SimulatedObservation:
    """Everything in a simulated world, exactly and at once."""

    def __init__(self, world: PhysicsWorld, controllers: SimulatedControllers):
        """
        Args:
            world: what is seen.
            controllers: they go on while time passes.
        """
        self._world, self._controllers = world, controllers
        self._scene = world.scene
        self._changed = world.time

    def scene(self) -> Scene:
        """The scene with the bodies that were added or moved otherwise than by contact; the same while none was."""
        known, world = self._scene.bodies, self._world
        free = set(movable_bodies(world.scene))  # these move by contact
        watched = [name for name in world.body_names() if name not in free]
        now = {name: world.body(name) for name in watched}
        moved = [name for name in watched if name not in known or _apart(now[name].pose, known[name].pose)]
        if moved or len(watched) != sum(name not in free for name in known):
            kept = {name: body for name, body in world.scene.bodies.items() if name in free}
            self._scene = replace(world.scene, bodies=kept | now)
            self._changed = world.time
        return self._scene

    def changed(self) -> float:
        """When bodies came, moved otherwise than by contact, or went for the last time, s of the world."""
        self.scene()
        return self._changed

    def wait_for_change(self, since: float, patience: float, canceled: Canceled) -> bool:
        """Let time pass until the scene has changed after ``since`` (s), for ``patience`` seconds at most."""
        until = self._world.time + patience
        while self.changed() <= since and self._world.time < until and not canceled():
            self._controllers.pass_time(LOOK_PERIOD)
        return self.changed() > since

    def state(self) -> SceneState:
        """Where everything is now."""
        return self._world.state()

    def settled(self) -> SceneState:
        """The state once all bodies are at rest, or after SETTLE_LIMIT."""
        until = self._world.time + SETTLE_LIMIT
        self._controllers.pass_time(LOOK_PERIOD)
        while self._world.time < until and self._fastest() > REST_VELOCITY:
            self._controllers.pass_time(LOOK_PERIOD)
        return self._world.state()

    def live_poses(self) -> Mapping[str, np.ndarray]:
        """Body -> its pose (7,) now."""
        return {name: self._world.body_pose(name) for name in self._world.body_names()}

    def grasped(self, robot: str, body: str) -> bool:
        """Whether every finger touches a body, given a moment to do so."""
        links = self._finger_links(robot)
        self._controllers.pass_time(GRIP_TIME, lambda: self._touching(robot, body) == links)
        return self._touching(robot, body) == links

    def touched(self, robot: str, body: str) -> bool:
        """Whether a finger touches a body."""
        return bool(self._touching(robot, body))

    def _touching(self, robot: str, body: str) -> set[str]:
        """The finger links of a robot that press on a body."""
        touching = {c.link_b for c in self._world.contacts(body) if c.b == robot and c.force > 0.0}
        return touching & self._finger_links(robot)

    def _finger_links(self, robot: str) -> set[str]:
        return set(self._world.scene.robots[robot].model.require_gripper().finger_links)

    def _fastest(self) -> float:
        """Largest speed of any movable body, m/s or rad/s."""
        bodies = movable_bodies(self._world.scene)
        return max((float(np.abs(self._world.body_velocity(name)).max()) for name in bodies), default=0.0)


class SimulatedClock:
    """The time of a simulated world."""

    def __init__(self, world: PhysicsWorld):
        """
        Args:
            world: whose time.
        """
        self._world = world

    def now(self) -> float:
        """Simulated seconds."""
        return self._world.time


def simulated_ports(world: PhysicsWorld, controllers: SimulatedControllers | None = None) -> Ports:
    """The ports of a plan executor that works in a simulated world.

    Args:
        world: at the start of a plan; used by nothing else meanwhile.
        controllers: of its robots; None: new ones, which hold the robots where they are.
    """
    controllers = controllers or SimulatedControllers(world)
    return Ports(controllers, SimulatedObservation(world, controllers), SimulatedClock(world))


def _own(command: Command) -> SimulatedCommand:
    if not isinstance(command, SimulatedCommand):
        raise TypeError(f"{command!r} was not sent to a simulated controller")
    return command


def _apart(T_a: np.ndarray, T_b: np.ndarray) -> bool:
    return float(np.abs(T_a - T_b).max()) > SAME_PLACE
