"""Compares the bodies with the plan that is executed: who fell, moved, is lost, and how far all are off the plan."""

from collections.abc import Mapping

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.drift import DriftTolerance, drift_reason
from hmap_core.execution.failures import Drifted
from hmap_core.execution.ports import Ports
from hmap_core.execution.report import Deviation, SegmentDrift
from hmap_core.planner.place_tool import tools_used
from hmap_core.trajectory.samples import index_at, movable_bodies, poses_at
from hmap_core.types import Body, Plan, SceneState, SegmentKind, ShapeKind

MOVED_LIMIT = 0.02  # m that a body which should stay may move
STAY_LIMIT = 0.001  # m; a body that the plan moves less than this should stay
FALL_LIMIT = 0.05  # m below where the plan has it, a body has fallen
TOPPLE_LIMIT = np.deg2rad(30.0)  # of tilt away from the plan, a body has toppled
LOST_POSITION, LOST_ANGLE = 0.05, np.deg2rad(30.0)  # m, rad off the plan at which a body counts as lost
LOST_TIME = 0.1  # s without touching the fingers, a held body has slipped out
WATCH_PERIOD = 0.02  # s between looks at the bodies
SAME_TIME = 1e-6  # s


class Watcher:
    """Compares the movable bodies with the plan that is executed.

    Attributes:
        fell: body -> planned time (s) at which it had fallen or toppled.
        moved: body that should stay -> the farthest it was from its place (m), where that is too far.
    """

    def __init__(self, plan: Plan, ports: Ports, places: Mapping[str, np.ndarray] | None = None):
        """
        Args:
            plan: that is executed.
            ports: to see the bodies.
            places: body -> the pose (7,) at which it should stay if the plan leaves it alone; None: where the plan's
                scene has it.
        """
        self.fell: dict[str, float] = {}
        self.moved: dict[str, float] = {}
        self._plan, self._ports = plan, ports
        self._bodies = movable_bodies(plan.scene)
        self._axes = {name: _axis(plan.scene.bodies[name]) for name in self._bodies}
        self._places = {name: plan.scene.bodies[name].pose for name in self._bodies} | dict(places or {})
        self._staying = [name for name in self._bodies if planned_motion(plan, name) < STAY_LIMIT]
        self._lost_since: dict[str, float] = {}
        self._next_look = -np.inf
        self._marks: dict[int, dict[str, Deviation]] = {}

    def look(self, sample: int, held: Mapping[str, str]) -> None:
        """During a motion, where poses are known at once: look at everything, unless it was done just now.

        Args:
            sample: where the plan is.
            held: robot -> the body that it grips.

        Raises:
            ExecutionError: OBJECT_DROPPED; a body has fallen or has slipped out of the fingers.
        """
        now = self._ports.clock.now()
        if now < self._next_look:
            return
        self._next_look = now + WATCH_PERIOD
        poses = self._ports.observation.live_poses()
        if poses is not None:
            planned = poses_at(self._plan, sample)
            for name in self._bodies:
                self._watch_place(name, poses[name])
                self._watch_fall(name, planned[name], poses[name], sample)
        self._lost_since = {robot: since for robot, since in self._lost_since.items() if robot in held}
        for robot, body in held.items():
            self._watch_grip(robot, body, sample)

    def mark(self, sample: int, state: SceneState) -> None:
        """At rest: remember how far every body is off the plan at a sample."""
        planned = poses_at(self._plan, sample)
        known = [name for name in self._bodies if name in state.poses]
        self._marks[sample] = {name: deviation(planned[name], state.poses[name]) for name in known}
        for name in known:
            self._watch_place(name, state.poses[name])

    def check_lost(self, sample: int) -> None:
        """At rest: make sure that every body is about where the plan has it at a sample.

        Raises:
            ExecutionError: OBJECT_DROPPED.
        """
        observation = self._ports.observation
        if self._lost(sample, observation.state()):  # which may be of before the end of the stretch
            reason = self._lost(sample, observation.settled())
            if reason:
                raise ExecutionError(reason, Code.OBJECT_DROPPED)

    def check_drift(self, sample: int, tolerance: DriftTolerance) -> None:
        """At rest between contacts: make sure that the rest of the plan still fits.

        Args:
            sample: of the plan, up to which it was followed.
            tolerance: what bodies may be off the plan.

        Raises:
            Drifted: a body is too far off the plan.
        """
        reason = self._drift(sample, self._ports.observation.settled(), tolerance)
        if reason is not None:
            raise Drifted(reason)

    def segment_drift(self) -> tuple[SegmentDrift, ...]:
        """Deviations at both ends of the contact segments whose ends were marked."""
        found = []
        for index, segment in enumerate(self._plan.segments):
            first, last = (index_at(self._plan.trajectory.time, t) for t in (segment.start, segment.end))
            if segment.kind is SegmentKind.TRANSIT or not (first in self._marks and last in self._marks):
                continue
            ends = self._marks[first][segment.contact_object], self._marks[last][segment.contact_object]
            found.append(SegmentDrift(index, segment.kind, segment.robot, segment.contact_object, *ends))
        return tuple(found)

    def _lost(self, sample: int, state: SceneState) -> str:
        """What has become of a body that is far from where the plan has it; empty where there is none."""
        for name, planned in poses_at(self._plan, sample).items():
            if name not in state.poses:
                continue
            distance, angle = transforms.distance(planned, state.poses[name])
            if distance > LOST_POSITION or angle > LOST_ANGLE:
                return (
                    f"{name!r} is {distance:.3f} m and {np.rad2deg(angle):.0f} deg off the plan at "
                    f"{self._plan.trajectory.time[sample]:.2f} s; {LOST_POSITION} m, {np.rad2deg(LOST_ANGLE):.0f} deg "
                    "allowed"
                )
        return ""

    def _drift(self, sample: int, state: SceneState, tolerance: DriftTolerance) -> str | None:
        """What is too far off the plan for the rest of it, or None.

        The goal's object may be as far off as in the end, once the plan leaves it alone; a tool in any way, once
        nothing more is done with it.
        """
        plan = self._plan
        planned, goal, now = poses_at(plan, sample), plan.scene.goal, plan.trajectory.time[sample]
        ahead = [segment for segment in plan.segments if segment.start >= now - SAME_TIME]
        for tool in tools_used(plan) - {segment.manipulator for segment in ahead}:
            planned.pop(tool, None)
        if not any(segment.object == goal.object for segment in ahead):
            planned.pop(goal.object, None)
            allowed = DriftTolerance(*plan.scene.execution_tolerance)
            reason = drift_reason({goal.object: goal.pose}, state.poses, allowed)
            if reason is not None:
                return reason
        return drift_reason(planned, state.poses, tolerance)

    def _watch_place(self, name: str, pose: np.ndarray) -> None:
        if name in self._staying:
            distance = float(np.linalg.norm(pose[:3] - self._places[name][:3]))
            if distance > max(MOVED_LIMIT, self.moved.get(name, 0.0)):
                self.moved[name] = distance

    def _watch_fall(self, name: str, planned: np.ndarray, pose: np.ndarray, sample: int) -> None:
        drop, tilt = planned[2] - pose[2], _tilt(planned, pose, self._axes[name])
        if name in self.fell or (drop <= FALL_LIMIT and tilt <= TOPPLE_LIMIT):  # a pose of NaN has fallen
            return
        t = float(self._plan.trajectory.time[sample])
        self.fell[name] = t
        raise ExecutionError(
            f"'{name}' fell at {t:.2f} s: it is {drop:.3f} m below and tilted {np.rad2deg(tilt):.0f} deg from "
            "where the plan has it",
            Code.OBJECT_DROPPED,
        )

    def _watch_grip(self, robot: str, body: str, sample: int) -> None:
        if self._ports.observation.touched(robot, body) is not False:  # None: no touch sensors
            self._lost_since.pop(robot, None)
            return
        now = self._ports.clock.now()
        if now - self._lost_since.setdefault(robot, now) >= LOST_TIME:
            t = self._plan.trajectory.time[sample]
            raise ExecutionError(f"'{body}' slipped out of the gripper of '{robot}' at {t:.2f} s", Code.OBJECT_DROPPED)


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


def _axis(body: Body) -> np.ndarray | None:
    """Axis (3,) about which a body can roll and still lie as before, in its frame; zeros: any; None: there is none."""
    if len(body.shapes) != 1 or body.shapes[0].kind not in (ShapeKind.CYLINDER, ShapeKind.CAPSULE, ShapeKind.SPHERE):
        return None
    shape = body.shapes[0]
    return np.zeros(3) if shape.kind is ShapeKind.SPHERE else transforms.rotation_matrix(shape.pose)[:, 2]


def _tilt(T_a: np.ndarray, T_b: np.ndarray, axis: np.ndarray | None) -> float:
    """Angle in radians between the body's vertical directions at two poses; what rolls about its axis does not tilt."""
    R_a, R_b = transforms.rotation_matrix(T_a), transforms.rotation_matrix(T_b)
    up = R_b @ R_a.T[:, 2]
    tilt = np.arccos(np.clip(up[2], -1.0, 1.0))
    if axis is not None:
        heights = np.clip([(R_a @ axis)[2], (R_b @ axis)[2]], -1.0, 1.0)
        tilt = np.minimum(tilt, abs(np.subtract(*np.arcsin(heights))))
    return float(tilt)
