"""The thread that owns the simulation: it steps it, updates the controllers, and executes calls in between."""

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from hmap_core.exceptions import Code, HmapError, InputError
from hmap_core.simulation.controllers import GripperController, Outcome, Tolerances, TrajectoryController, from_instant
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import JointTrajectory, Scene

CHUNK = 5  # steps between two checks of calls and clocks
CALL_TIMEOUT = 10.0  # s of real time until a call has to be executed
MAX_LAG = 0.2  # s of real time; a simulation does not catch up a larger delay

T = TypeVar("T")


@dataclass
class Motion:
    """A running command of a controller.

    Attributes:
        done: set when the command has ended.
        outcome: how it ended.
        reason: text for an error.
        state: the controller's last state (Tracking or GripperResult).
    """

    done: threading.Event = field(default_factory=threading.Event)
    outcome: Outcome = Outcome.ACTIVE
    reason: str = ""
    state: Any = None

    def finish(self, outcome: Outcome, reason: str = "") -> None:
        """Set the outcome; the first call counts."""
        if not self.done.is_set():
            self.outcome, self.reason = outcome, reason
            self.done.set()


class WorldLoop(threading.Thread):
    """Steps a :class:`SimulatedWorld` in a thread of its own, which is the only one that accesses it.

    Args:
        scene: the scene at the start.
        speed: simulated seconds per second while a controller moves; 0: as fast as possible.
        idle_speed: the same while no controller moves.
        on_chunk: called in the thread, every few steps.

    Attributes:
        scene: the current scene, including added bodies.
    """

    def __init__(self, scene: Scene, speed: float, idle_speed: float, on_chunk: Callable[[SimulatedWorld], None]):
        super().__init__(name="world", daemon=True)
        self._speed, self._idle_speed, self._on_chunk = speed, idle_speed, on_chunk
        self._calls: queue.Queue[tuple[Callable, Future]] = queue.Queue()
        self._end = threading.Event()
        self.world = SimulatedWorld(scene)
        self._start(scene)

    def _start(self, scene: Scene) -> None:
        self.scene = scene
        start = scene.start_state()
        self.added: set[str] = set()
        robots = scene.robots
        self._arms = {
            name: TrajectoryController(robot.model.joint_names, robot.q, robot.model.acceleration_limits)
            for name, robot in robots.items()
        }
        self._grippers = {
            name: GripperController(robot.model.gripper, start.gripper[name])
            for name, robot in robots.items()
            if robot.model.gripper
        }
        self._motions: dict[object, Motion] = {}

    # from any thread

    def call(self, function: Callable[[], T]) -> T:
        """Run a function between two steps.

        Returns:
            The result of the function.

        Raises:
            HmapError: the simulation is shutting down or does not answer.
            Exception: whatever the function raises.
        """
        if self._end.is_set():
            raise HmapError("the simulation is shutting down")
        answer: Future = Future()
        self._calls.put((function, answer))
        try:
            return answer.result(CALL_TIMEOUT)
        except TimeoutError:
            raise HmapError("the simulation does not answer; it is shutting down or hangs") from None

    def stop(self) -> None:
        """End the thread and all waiting calls."""
        self._end.set()
        if self.is_alive():
            self.join()
        self.world.close()

    def load(self, scene: Scene) -> None:
        """Restart the simulation with a scene, which can be the current one."""
        self._end_motions("the scene was loaded anew")
        self.world.reset(scene)
        self._start(scene)

    def follow(
        self, robot: str, trajectory: JointTrajectory, tolerances: Tolerances, start: float | None = None
    ) -> Motion:
        """Start a trajectory.

        Args:
            robot: name of the robot.
            trajectory: the commanded samples.
            tolerances: of the path and the goal.
            start: simulated time (s) of the trajectory's time 0; None: now.

        Raises:
            InputError: the controller rejects the trajectory, all of it is in the past, or the scene has no such robot.
        """

        def begin() -> Motion:
            now = self.world.time
            left = trajectory if start is None else from_instant(trajectory, start, now)
            return self._begin(_of(self._arms, robot, "arm"), left, now, tolerances)

        return self.call(begin)

    def grip(self, robot: str, opening: float, force: float) -> Motion:
        """Start a gripper command.

        Args:
            robot: name of the robot.
            opening: gap between the pads, m.
            force: N.

        Raises:
            InputError: the controller rejects the command, or the scene has no such robot.
        """
        return self.call(lambda: self._begin(_of(self._grippers, robot, "gripper"), opening, force))

    def cancel_arm(self, robot: str) -> None:
        """Stop an arm; one that left with another scene stands already."""

        def cancel() -> None:
            if robot in self._arms:
                self._arms[robot].cancel(self.world.time)

        self.call(cancel)

    def cancel_gripper(self, robot: str) -> None:
        """Stop a gripper at its current opening; one that left with another scene stands already."""

        def cancel() -> None:
            if robot in self._grippers:
                self._grippers[robot].cancel()

        self.call(cancel)

    def stop_arms(self) -> list[str]:
        """Stop all arms that move; grippers keep what they hold.

        Returns:
            the robots whose arms moved.
        """

        def stop() -> list[str]:
            moving = [name for name, arm in self._arms.items() if arm.moving]
            for name in moving:
                self._arms[name].cancel(self.world.time)
            return moving

        return self.call(stop)

    # bodies; called inside :meth:`call`

    def scene_without_added(self) -> Scene:
        """The scene without added bodies."""
        kept = {name: body for name, body in self.scene.bodies.items() if name not in self.added}
        return replace(self.scene, bodies=kept)

    def add(self, body) -> None:
        """Add a body to world and scene."""
        self.world.add_body(body)
        self.added.add(body.name)
        self.scene = replace(self.scene, bodies=self.scene.bodies | {body.name: body})

    def move(self, name: str, pose) -> None:
        """Move a body to T_world_body (7,).

        Raises:
            InputError: the body cannot be moved there.
        """
        self._movable(name)
        self.world.move_body(name, pose)
        moved = replace(self.scene.bodies[name], pose=self.world.body_pose(name))
        self.scene = replace(self.scene, bodies=self.scene.bodies | {name: moved})

    def remove(self, name: str) -> None:
        """Remove a body from world and scene.

        Raises:
            InputError: the body is the object of the task, or it cannot be removed.
        """
        if name == self.scene.goal.object:
            raise InputError(f"{name!r} is the object of the task and stays")
        self.world.remove_body(name)
        self.added.discard(name)
        removable = {key: pose for key, pose in self.scene.removable.items() if key != name}
        kept = {key: body for key, body in self.scene.bodies.items() if key != name}
        self.scene = replace(self.scene, bodies=kept, removable=removable)

    def _movable(self, name: str) -> None:
        if name not in self.scene.bodies:
            known = ", ".join(self.scene.bodies)
            raise InputError(f"no body {name!r} in the world; there are: {known}", Code.UNKNOWN_OBJECT)
        if self.scene.bodies[name].kind == "fixed" and name not in self.added:
            raise InputError(f"{name!r} is a fixed body of the scene")
        for contact in self.world.contacts(name):
            gripper = self.scene.robots[contact.b].model.gripper if contact.b in self.scene.robots else None
            if gripper and contact.link_b in gripper.finger_links:
                raise InputError(f"{name!r} is held by {contact.b!r}")

    # the thread

    def run(self) -> None:
        """Step the simulation until :meth:`stop`."""
        began, simulated = time.monotonic(), self.world.time
        while not self._end.is_set():
            self._take_calls()
            speed = self._speed if self._busy() else self._idle_speed
            now = time.monotonic()
            due = simulated + speed * (now - began)
            if speed == 0.0 or self.world.time < due:
                for _ in range(CHUNK):
                    self._step()
                self._on_chunk(self.world)
            else:
                self._take_calls((self.world.time - due) / speed)
            if speed == 0.0 or due - self.world.time > MAX_LAG * speed or self._pace != speed:
                began, simulated, self._pace = time.monotonic(), self.world.time, speed
        self._end_motions("the world is shutting down")
        self._refuse_calls()

    _pace = 0.0

    def _busy(self) -> bool:
        arms = any(arm.moving for arm in self._arms.values())
        return arms or any(gripper.active for gripper in self._grippers.values())

    def _begin(self, controller, *command) -> Motion:
        controller.start(*command)  # raises before anything changes
        if controller in self._motions:
            self._motions[controller].finish(Outcome.PREEMPTED, "another command took its place")
        self._motions[controller] = motion = Motion()
        return motion

    def _end_motions(self, reason: str) -> None:
        for motion in self._motions.values():
            motion.finish(Outcome.CANCELED, reason)

    def _take_calls(self, wait: float = 0.0) -> None:
        """Execute the waiting calls; wait at most ``wait`` seconds for the first."""
        while True:
            try:
                function, answer = self._calls.get(wait > 0.0, wait or None)
            except queue.Empty:
                return
            wait = 0.0
            try:
                answer.set_result(function())
            except Exception as error:
                answer.set_exception(error)

    def _refuse_calls(self) -> None:
        while not self._calls.empty():
            self._calls.get()[1].set_exception(HmapError("the simulation is shutting down"))

    def _step(self) -> None:
        now = self.world.time
        for name, arm in self._arms.items():
            robot = self.world.robot(name)
            desired = arm.update(now, *robot.arm_state())
            robot.set_joint_targets(desired.q, desired.qd, desired.effort)
            self._follow_up(arm, desired, arm.reason)
        for name, gripper in self._grippers.items():
            robot = self.world.robot(name)
            robot.set_gripper(*gripper.update(now, *robot.gripper_state()))
            self._follow_up(gripper, gripper.result, "")
        self.world.step()

    def _follow_up(self, controller, state, reason: str) -> None:
        motion = self._motions.get(controller)
        if motion is not None and not motion.done.is_set():
            motion.state = state
            if not controller.active:
                motion.finish(controller.outcome, reason)


def _of(controllers: dict[str, T], robot: str, what: str) -> T:
    """The controller of a robot.

    Raises:
        InputError: UNKNOWN_ROBOT; another scene has been loaded meanwhile.
    """
    if robot not in controllers:
        known = ", ".join(controllers) or "none"
        raise InputError(f"robot {robot!r} has no {what} in the loaded scene; there are: {known}", Code.UNKNOWN_ROBOT)
    return controllers[robot]
