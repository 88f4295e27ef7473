"""Looks at the bodies while a plan is executed: who fell, who moved, who is no longer held, how far all are off it."""

from collections.abc import Mapping

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.report import Deviation, SegmentDrift
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.trajectory.samples import index_at
from hmap_core.types import BodyKind, Plan, SegmentKind

MOVED_LIMIT = 0.02  # m that a body which should stay may move
STAY_LIMIT = 0.001  # m; a body that the plan moves less than this should stay
FALL_LIMIT = 0.05  # m below where the plan has it, a body has fallen
TOPPLE_LIMIT = np.deg2rad(30.0)  # of tilt away from the plan, a body has toppled
LOST_TIME = 0.1  # s without touching the fingers, a held body has slipped out
WATCH_PERIOD = 0.02  # s between looks at the bodies


class Watcher:
    """Compares the movable bodies of a world with the plan that is executed in it.

    Attributes:
        fell: body -> planned time (s) at which it had fallen or toppled.
        moved: body that should stay -> the farthest it was from its place (m), where that is too far.
    """

    def __init__(self, plan: Plan, world: SimulatedWorld, places: Mapping[str, np.ndarray] | None = None):
        """
        Args:
            places: body -> the pose (7,) at which it should stay if the plan leaves it alone; None: where the plan's
                scene has it.
        """
        self.fell: dict[str, float] = {}
        self.moved: dict[str, float] = {}
        self._plan, self._world = plan, world
        self._bodies = [b.name for b in plan.scene.bodies.values() if b.kind is not BodyKind.FIXED]
        self._start = {name: plan.scene.bodies[name].pose for name in self._bodies}
        self._places = self._start | dict(places or {})
        self._staying = [name for name in self._bodies if planned_motion(plan, name) < STAY_LIMIT]
        self._lost_since: dict[str, float] = {}
        self._next_look = 0.0
        self._marks: dict[int, dict[str, Deviation]] = {}

    def look(self, sample: int, held: dict[str, str]) -> None:
        """Look at everything, unless it was done just now.

        Raises:
            ExecutionError: a body has fallen or is no longer held.
        """
        if self._world.time < self._next_look:
            return
        self._next_look = self._world.time + WATCH_PERIOD
        for name in self._bodies:
            self._look_at(name, sample)
        self._lost_since = {r: t for r, t in self._lost_since.items() if r in held}
        for robot, body in held.items():
            self._look_at_grip(robot, body, sample)

    def mark(self, sample: int) -> None:
        """Remember how far every body is off the plan at a sample."""
        poses = {name: self._world.body_pose(name) for name in self._bodies}
        self._marks[sample] = {name: deviation(self._planned(name, sample), pose) for name, pose in poses.items()}

    def drift(self) -> tuple[SegmentDrift, ...]:
        """Deviations at both ends of the contact segments whose ends were marked."""
        found = []
        for index, segment in enumerate(self._plan.segments):
            first, last = (index_at(self._plan.trajectory.time, t) for t in (segment.start, segment.end))
            if segment.kind is SegmentKind.TRANSIT or not (first in self._marks and last in self._marks):
                continue
            ends = self._marks[first][segment.object], self._marks[last][segment.object]
            found.append(SegmentDrift(index, segment.kind, segment.robot, segment.object, *ends))
        return tuple(found)

    def fastest(self) -> float:
        """Largest speed of any body, m/s or rad/s."""
        return max((float(np.abs(self._world.body_velocity(name)).max()) for name in self._bodies), default=0.0)

    def touches_fingers(self, robot: str, body: str, every_finger: bool) -> bool:
        """Whether a body touches the fingers of a robot: each of them, or at least one."""
        links = set(self._plan.scene.robots[robot].model.gripper.finger_links)
        touched = {c.link_b for c in self._world.contacts(body) if c.b == robot and c.force > 0.0} & links
        return touched == links if every_finger else bool(touched)

    def _look_at(self, name: str, sample: int) -> None:
        pose = self._world.body_pose(name)
        if name in self._staying:
            distance = float(np.linalg.norm(pose[:3] - self._places[name][:3]))
            if distance > max(MOVED_LIMIT, self.moved.get(name, 0.0)):
                self.moved[name] = distance
        planned = self._planned(name, sample)
        drop, tilt = planned[2] - pose[2], _tilt(planned, pose)
        if name not in self.fell and not (drop <= FALL_LIMIT and tilt <= TOPPLE_LIMIT):  # nor when not a number
            t = float(self._plan.trajectory.time[sample])
            self.fell[name] = t
            raise ExecutionError(
                f"'{name}' fell at {t:.2f} s: it is {drop:.3f} m below and tilted {np.rad2deg(tilt):.0f} deg from "
                "where the plan has it",
                Code.OBJECT_DROPPED,
            )

    def _look_at_grip(self, robot: str, body: str, sample: int) -> None:
        if self.touches_fingers(robot, body, every_finger=False):
            self._lost_since.pop(robot, None)
            return
        since = self._lost_since.setdefault(robot, self._world.time)
        if self._world.time - since >= LOST_TIME:
            t = self._plan.trajectory.time[sample]
            raise ExecutionError(f"'{body}' slipped out of the gripper of '{robot}' at {t:.2f} s", Code.OBJECT_DROPPED)

    def _planned(self, name: str, sample: int) -> np.ndarray:
        poses = self._plan.trajectory.objects.get(name)
        return self._start[name] if poses is None else poses[sample]


def planned_motion(plan: Plan, name: str, end: int | None = None) -> float:
    """How far (m) a plan moves a body from where it begins, up to a sample (None: to the end of the plan)."""
    poses = plan.trajectory.objects.get(name)
    if poses is None:
        return 0.0
    return float(np.linalg.norm(poses[:end, :3] - poses[0, :3], axis=1).max(initial=0.0))


def deviation(T_planned: np.ndarray, T_actual: np.ndarray) -> Deviation:
    """How far apart two poses (7,) are."""
    distance, angle = transforms.distance(T_planned, T_actual)
    return Deviation(distance, float(np.rad2deg(angle)))


def _tilt(T_a: np.ndarray, T_b: np.ndarray) -> float:
    """Angle in radians between the body's vertical directions at two poses; turning about the vertical is no tilt."""
    up = transforms.rotation_matrix(T_b) @ transforms.rotation_matrix(T_a).T[:, 2]
    return float(np.arccos(np.clip(up[2], -1.0, 1.0)))
