"""Hand-written plans for one Panda: grasp a box from above, drag it along the table, let go."""

import numpy as np
from scipy.spatial.transform import Rotation
from simulation_fixtures import HOME, box, panda_model, scene

from hmap_core import transforms
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.robots import SimulatedRobot
from hmap_core.trajectory.timing import time_parameterise
from hmap_core.types import BodyKind, Goal, Plan, Robot, Scene, Segment, SegmentKind, Trajectory

DT = 0.02
DOWN = (1.0, 0.0, 0.0, 0.0)  # approach axis down, closing axis along y
RAMP = 0.5  # s for the gripper to open or close
SLOW = 0.25  # share of the limits while something is held


class Arm:
    """Kinematics of a lone Panda at the origin, from PyBullet."""

    def __init__(self):
        self.model = panda_model()
        self._client = BulletClient()
        self._robot = SimulatedRobot(self._client, Robot("arm", self.model, transforms.pose(), HOME))

    def pose(self, q: np.ndarray) -> np.ndarray:
        self._robot.place(q, 0.08)
        return self._robot.end_effector_pose()

    def inverse(self, target: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Configuration near ``q`` that reaches a pose, by damped least squares with numeric derivatives."""
        for _ in range(100):
            error = self._error(target, q)
            if np.linalg.norm(error) < 1e-6:
                return q
            J = np.column_stack([(self._error(target, q + 1e-5 * e) - error) / -1e-5 for e in np.eye(7)])
            q = q + np.clip(J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), error), -0.2, 0.2)
        raise AssertionError(f"no configuration reaches {target}")

    def _error(self, target: np.ndarray, q: np.ndarray) -> np.ndarray:
        pose = self.pose(q)
        turn = Rotation.from_quat(target[3:]) * Rotation.from_quat(pose[3:]).inv()
        return np.concatenate([target[:3] - pose[:3], turn.as_rotvec()])

    def line(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Joint path (M, 7) along a straight line, a point every 2 cm."""
        start = self.pose(q)
        steps = max(2, int(np.linalg.norm(target[:3] - start[:3]) / 0.02) + 1)
        path = [q]
        for s in np.linspace(0.0, 1.0, steps)[1:]:
            path.append(self.inverse(transforms.interpolate(start, target, s), path[-1]))
        return np.array(path)


class Writer:
    """Puts a plan together piece by piece."""

    def __init__(self, scene: Scene):
        self.scene, self.arm = scene, Arm()
        self.q = [scene.robots["left"].q[None]]
        self.opening = [np.array([0.08])]
        self.poses = {n: [b.pose[None]] for n, b in scene.bodies.items() if n != "table"}
        self.segments: list[Segment] = []

    @property
    def time(self) -> float:
        return (sum(map(len, self.q)) - 1) * DT

    def move(self, position, held: str | None = None) -> None:
        """Straight to a point with the fingers down, carrying a body or not."""
        limits = SLOW * self.arm.model.velocity_limits, SLOW * self.arm.model.acceleration_limits
        path = self.arm.line(self.q[-1][-1], transforms.pose(position, DOWN))
        q = time_parameterise(path, *limits, DT).q[1:]
        bodies = {n: np.repeat(p[-1][-1:], len(q), axis=0) for n, p in self.poses.items()}
        if held:
            T_ee_obj = transforms.multiply(transforms.inverse(self.arm.pose(path[0])), self.poses[held][-1][-1])
            bodies[held] = np.array([transforms.multiply(self.arm.pose(x), T_ee_obj) for x in q])
        self._add(q, np.full(len(q), self.opening[-1][-1]), bodies)

    def grip(self, opening: float) -> None:
        """Change the opening at rest."""
        n = round(RAMP / DT)
        ramp = np.linspace(self.opening[-1][-1], opening, n + 1)[1:]
        bodies = {name: np.repeat(p[-1][-1:], n, axis=0) for name, p in self.poses.items()}
        self._add(np.repeat(self.q[-1][-1:], n, axis=0), ramp, bodies)

    def segment(self, start: float, kind: SegmentKind, body: str | None = None) -> None:
        """Name what happened since ``start``."""
        self.segments.append(Segment(start, self.time, "left", "panda_hand", body, kind))

    def plan(self) -> Plan:
        q = np.concatenate(self.q)
        trajectory = Trajectory(
            time=np.arange(len(q)) * DT,
            joints={"left": q},
            gripper={"left": np.concatenate(self.opening)},
            objects={name: np.concatenate(poses) for name, poses in self.poses.items()},
        )
        return Plan(self.scene, trajectory, tuple(self.segments), np.zeros((0, 7)), {})

    def _add(self, q: np.ndarray, opening: np.ndarray, bodies: dict[str, np.ndarray]) -> None:
        self.q.append(q)
        self.opening.append(opening)
        for name, poses in bodies.items():
            self.poses[name].append(poses)


def drag_plan(scene: Scene, body: str, width: float, by, lift: float = 0.0, offset=(0.0, 0.0, 0.0)) -> Plan:
    """Grasp a body (``offset`` from its centre), move it by a vector, by way of ``lift`` above the table, let go."""
    w = Writer(scene)
    grasp = scene.bodies[body].pose[:3] + offset
    w.move(grasp + [0, 0, 0.15])
    w.move(grasp)
    w.grip(width)
    w.segment(0.0, SegmentKind.TRANSIT)
    start, target = w.time, grasp + by
    if lift:
        w.move(grasp + [0, 0, lift], body)
        w.move(target + [0, 0, lift], body)
    w.move(target, body)
    w.segment(start, SegmentKind.GRASP, body)
    start = w.time
    w.grip(0.08)
    w.move(target + [0, 0, 0.15])
    w.segment(start, SegmentKind.TRANSIT)
    return w.plan()


def tool_push_plan(goal: Goal) -> Plan:
    """Grasp a stick, push a box 8 cm with it, retreat with the stick still attached."""
    stick = box("stick", (0.3, 0.04, 0.04), (0.35, -0.1, 0.02), BodyKind.TOOL, mass=0.15)
    target = box("box", (0.06, 0.06, 0.06), (0.45, 0.0, 0.03))
    w = Writer(scene(target, stick, goal=goal))
    grasp = np.array([0.3, -0.1, 0.02])
    w.move(grasp + [0, 0, 0.15])
    w.move(grasp)
    w.grip(0.04)
    w.segment(0.0, SegmentKind.TRANSIT)
    start = w.time
    w.move(grasp + [0, 0, 0.005], "stick")
    w.move(grasp + [0, 0.05, 0.005], "stick")
    w.segment(start, SegmentKind.GRASP, "stick")
    start = w.time
    w.move(grasp + [0, 0.13, 0.005], "stick")
    w.segments.append(Segment(start, w.time, "left", "stick", "box", SegmentKind.PUSH))
    start = w.time
    w.move(grasp + [0, 0.10, 0.0], "stick")
    w.segments.append(Segment(start, w.time, "left", "stick", None, SegmentKind.TRANSIT))
    plan = w.plan()
    front = np.maximum.accumulate(plan.trajectory.objects["stick"][:, 1]) + 0.05
    plan.trajectory.objects["box"][:, 1] = np.maximum(plan.trajectory.objects["box"][:, 1], front)
    return plan
