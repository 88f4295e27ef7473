"""A world without dynamics for the tests of execution: arms follow exactly, and grippers attach what is between them.

Its ports are like those of a graph with real robots: no touch sensors, and no poses at the very instant.
"""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, ExecutionError, PlannerError
from hmap_core.execution.ports import Feedback, Ports
from hmap_core.kinematics.arm import load_arm
from hmap_core.simulation.controllers import from_instant
from hmap_core.types import Body, JointTrajectory, Robot, Scene, SceneState

STEP = 0.02  # s
REACH = 0.03  # m from the end effector within which a body is between the fingers
GRIP_TIME = 0.1  # s


@dataclass
class KinematicCommand:
    """A command under way."""

    robot: Robot
    motion: JointTrajectory | None  # None: of the gripper
    start: float
    end: float
    opening: float = 0.0
    done: bool = False
    canceled: bool = False
    feedback: tuple[Feedback, ...] = ()


class KinematicWorld:
    """Robots and bodies; time passes when somebody lets it."""

    def __init__(self, scene: Scene):
        self.scene, self.time, self.changed = scene, 0.0, 0.0
        self.now = scene.start_state()
        self._attached: dict[str, tuple[str, np.ndarray]] = {}
        self._commands: list[KinematicCommand] = []
        for robot in scene.robots:
            self._tip(robot)  # compiles it before anybody waits

    def add_body(self, body: Body) -> None:
        self.scene = replace(self.scene, bodies=self.scene.bodies | {body.name: body})
        self.now.poses[body.name], self.changed = body.pose, self.time

    def remove_body(self, name: str) -> None:
        kept = {key: body for key, body in self.scene.bodies.items() if key != name}
        self.scene, self.changed = replace(self.scene, bodies=kept), self.time
        del self.now.poses[name]

    def move_body(self, name: str, pose: np.ndarray) -> None:
        self.now.poses[name] = np.array(pose)

    def move(self, robot: Robot, motion: JointTrajectory, start: float | None = None) -> KinematicCommand:
        left = motion if start is None else from_instant(motion, start, self.time)
        if left.times[0] > 0.0:  # from where the joints are
            times, rows = np.r_[0.0, left.times], np.vstack([self.now.q[robot.name], left.positions])
            left = JointTrajectory(left.names, times, rows)
        for command in self._commands:
            command.done |= command.motion is not None and command.robot.name == robot.name
        return self._begin(KinematicCommand(robot, left, self.time, self.time + float(left.times[-1])))

    def grip(self, robot: Robot, opening: float, force: float) -> KinematicCommand:
        return self._begin(KinematicCommand(robot, None, self.time, self.time + GRIP_TIME, opening))

    def cancel(self, command: KinematicCommand) -> None:
        command.done = command.canceled = True

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.time += seconds
        for command in self._commands:
            self._follow(command)
        self._commands = [command for command in self._commands if not command.done]
        for robot, (body, T_ee_obj) in self._attached.items():
            self.now.poses[body] = transforms.multiply(self._tip(robot), T_ee_obj)

    def _begin(self, command: KinematicCommand) -> KinematicCommand:
        self._commands.append(command)
        return command

    def _follow(self, command: KinematicCommand) -> None:
        name = command.robot.name
        if command.done:
            return
        if command.motion is not None:
            into = self.time - command.start
            q = [np.interp(into, command.motion.times, column) for column in command.motion.positions.T]
            self.now.q[name] = np.array(q)
            report = Feedback(self.time, self.time, self.now.q[name])
            command.feedback = (*command.feedback[:1], report)
        elif self.time >= command.end:
            command.opening = self.now.gripper[name] = self._closed_on(name, command.opening)
        command.done = self.time >= command.end

    def _closed_on(self, robot: str, target: float) -> float:
        """The opening (m) that a gripper reaches; bodies are as wide as their first shape is along y."""
        tip = self._tip(robot)
        for name, body in self.scene.bodies.items():
            width = body.shapes[0].size[1] if body.kind != "fixed" else 0.0
            near = np.linalg.norm(self.now.poses[name][:3] - tip[:3]) < REACH
            if near and target < width:
                self._attached[robot] = name, transforms.multiply(transforms.inverse(tip), self.now.poses[name])
                return width
        self._attached.pop(robot, None)
        return target

    def _tip(self, robot: str) -> np.ndarray:
        placed = self.scene.robots[robot]
        return transforms.multiply(placed.base_pose, load_arm(placed.model).end_effector(self.now.q[robot]))


class KinematicControllers:
    """Waiting lets the time of the world pass."""

    tracking_error = 0.0

    def __init__(self, world: KinematicWorld):
        self._world, self.move, self.grip = world, world.move, world.grip

    def wait(self, commands, limit, canceled, look=None) -> None:
        until = self._world.time + limit
        while not all(command.done for command in commands):
            if canceled():
                for command in commands:
                    self._world.cancel(command)
                raise PlannerError("canceled", Code.CANCELED)
            if self._world.time > until:
                raise ExecutionError("hangs")
            if look is not None:
                look()
            self._world.advance(STEP)

    def common_start(self) -> None:
        """Time passes in wait only."""

    def stop(self) -> None:
        """Nothing moves outside of wait."""


class LateObservation:
    """What a scene monitor would know."""

    def __init__(self, world: KinematicWorld):
        self._world = world

    def scene(self) -> Scene:
        return self._world.scene

    def changed(self) -> float:
        return self._world.changed

    def wait_for_change(self, since, patience, canceled) -> bool:
        self._world.advance(patience)
        return self._world.changed > since

    def state(self) -> SceneState:
        return self._world.now.copy()

    settled = state

    def live_poses(self) -> None:
        return None

    def grasped(self, robot, body) -> None:
        return None

    touched = grasped


class WorldClock:
    """The time of the world."""

    def __init__(self, world: KinematicWorld):
        self._world = world

    def now(self) -> float:
        return self._world.time


def kinematic_ports(world: KinematicWorld) -> Ports:
    return Ports(KinematicControllers(world), LateObservation(world), WorldClock(world))
