"""Planning anew in the middle of a plan: what is still good of it is kept, the rest is asked of the backend.

Kept are, each checked against the world as it is now: the object's path, the contacts at the waypoints, and whole
segments where robots and object stand as the plan has them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hmap_core import transforms
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import ContactError
from hmap_core.execution.stretches import index_at
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.planner.conflicts import first_conflict, object_clearances, unknown_bodies
from hmap_core.planner.interfaces import Backend, RobotContact, SegmentMotion
from hmap_core.planner.local import away_from_home
from hmap_core.types import (
    Body,
    ContactKind,
    ContactPoint,
    Goal,
    Plan,
    Scene,
    SceneState,
    Segment,
    SegmentKind,
    Trajectory,
)
from hmap_core.waypoints import ObjectPath

POSITION_STEP, ROTATION_STEP = 0.01, float(np.deg2rad(3.0))  # m, rad between kept poses of the object
NEAR, NEAR_TURN = 0.01, float(np.deg2rad(5.0))  # m, rad off the path's begin at which it is still taken up
SAME, SAME_TURN = 1e-4, 1e-3  # m, rad: the object stands where the plan has it
SAME_JOINT = 1e-3  # rad: so does a robot
SAME_OPENING = 1e-3  # m: so does a gripper
ALIKE = 1e-3  # m, rad between two poses that mean the same place
STANDS = 0.005  # m; a hand that moves less after a contact does not leave it
SERVES = 0.5  # of the poses ahead that an old contact has to serve to be taken up on another path
PATH_MARGIN = 0.002  # m the object keeps from bodies that the plan does not know


@dataclass(frozen=True)
class KeptSegment:
    """A contact of the old plan with what belongs to it.

    Attributes:
        first, begin, end, last: samples at which the robot sets out, the contact is made, is left, the hand is back.
        segment: the contact's own.
    """

    first: int
    begin: int
    end: int
    last: int
    segment: Segment


def kept_segments(plan: Plan, object: str) -> list[KeptSegment]:
    """The contacts on an object in their order, each with the transits before and after it."""
    time = plan.trajectory.time
    found, first = [], 0
    for k, segment in enumerate(plan.segments):
        if segment.kind is SegmentKind.TRANSIT:
            continue
        after = plan.segments[k + 1] if k + 1 < len(plan.segments) else None
        leaves = after is not None and after.kind is SegmentKind.TRANSIT and after.robot == segment.robot
        last = index_at(time, after.end if leaves else segment.end)
        if segment.object == object:
            ends = index_at(time, segment.start), index_at(time, segment.end)
            found.append(KeptSegment(first, *ends, last, segment))
        first = last
    return found


class KeepingBackend:
    """A backend that first offers what is still good of an old plan; implements :class:`Backend`.

    Attributes:
        kept: what was kept: ``paths``, ``contacts``, ``motions``.
    """

    def __init__(self, backend: Backend, plan: Plan, bodies: dict[str, Body], at: float):
        """
        Args:
            backend: asked for the rest.
            plan: the old plan.
            bodies: all bodies as they are now; those that the plan does not know are checked against.
            at: planned time (s) up to which it was followed.
        """
        self._backend, self._plan = backend, plan
        self.grips, self.take, self.put_down = backend.grips, backend.take, backend.put_down
        self.check_contacts = backend.check_contacts
        self._new = unknown_bodies(plan, bodies)
        self._at = index_at(plan.trajectory.time, at)
        self._object = plan.scene.goal.object
        segments = kept_segments(plan, self._object)
        self._segments = [segment for segment in segments if segment.end > self._at]
        self._by_hand = [kept for kept in segments if not self._with_tool(kept)]
        self._path_offered = False
        self._used: set[bytes] = set()  # poses at which old contacts were offered
        self._chosen: dict[int, KeptSegment] = {}  # id of an offered contact -> where it is from
        self.kept = {"paths": 0, "contacts": 0, "motions": 0}

    def plan_waypoints(
        self, scene: Scene, state: SceneState, object: str, goal: Goal, seed: int, time_limit: float
    ) -> ObjectPath:
        """The rest of the old path, once, where it leads to the goal and is free; else as the backend says."""
        if not self._path_offered and object == self._object:
            self._path_offered = True
            path = self._rest_of_path(state.poses[object], goal)
            if path is not None:
                self.kept["paths"] += 1
                return path
        return self._backend.plan_waypoints(scene, state, object, goal, seed, time_limit)

    def propose_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robots: Sequence[str],
        cloud: Cloud | None,
        count: int,
        seed: int,
        time_limit: float,
    ) -> list[RobotContact]:
        """The old plan's contact at this place, once; else as the backend says.

        On another path the old ones are checked for the poses ahead, as checking a few is faster than looking for
        others. On the old path the backend is asked first for one that ends where the old one did, as the contacts
        after it may still be good.
        """

        def ask(poses: np.ndarray) -> list[RobotContact]:
            return self._backend.propose_contacts(scene, state, object, poses, robots, cloud, count, seed, time_limit)

        place = object_poses[0].tobytes()
        if object != self._object or place in self._used or any(scene.robots[r].model.held for r in robots):
            return ask(object_poses)
        self._used.add(place)
        here = self._kept_here(object_poses)
        found = self._contact(scene, state, here[0], object_poses[: here[1] + 1]) if here else None
        if found is not None and found.robot in (robots or scene.robots):
            self.kept["contacts"] += 1
            return [found]
        known = [] if here else self._known(scene, state, object_poses, robots or tuple(scene.robots), seed)
        if known:
            self.kept["contacts"] += 1
            return known
        if here and here[1] + 1 < len(object_poses):
            try:
                return ask(object_poses[: here[1] + 1])
            except ContactError:
                pass
        return ask(object_poses)

    def solve_segment(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        contact: RobotContact,
        object_poses: np.ndarray,
        seed: int,
        time_limit: float,
    ) -> SegmentMotion:
        """The old plan's motion where it begins in this state and is free; else as the backend says."""
        kept = self._chosen.get(id(contact.contact))
        if kept is not None and self._continues(state, kept, object_poses) and self._free(kept.first, kept.last):
            self.kept["motions"] += 1
            return self._motion(state, kept)
        return self._backend.solve_segment(scene, state, object, contact, object_poses, seed, time_limit)

    # the object's path

    def _rest_of_path(self, pose: np.ndarray, goal: Goal) -> ObjectPath | None:
        poses, marks = self._rest()
        moved, turned = transforms.distance(poses[0], pose)
        if moved > NEAR or turned > NEAR_TURN or not _alike(poses[-1], goal.pose) or len(poses) < 2:
            return None
        poses = np.concatenate([pose[None], poses[1:]])
        clearance = np.full(len(poses), np.inf)
        own = body_set(self._plan.scene.bodies[self._object])
        for body in self._new.values():
            clearance = np.minimum(clearance, object_clearances(own, _denser(poses), body).min())
        if clearance.min() < PATH_MARGIN:
            return None
        flat = np.abs(poses[:, 2] - poses[0, 2]).max() < POSITION_STEP
        return ObjectPath(transforms.consistent(poses), marks, clearance, "planar" if flat else "spatial")

    def _rest(self) -> tuple[np.ndarray, np.ndarray]:
        """What is left of the object's path, in its steps: poses (M, 7), and their indices where contacts end."""
        rows = self._plan.trajectory.objects[self._object]
        poses, marks = [rows[self._at]], []
        for kept in self._segments:
            for k in range(max(kept.begin, self._at) + 1, kept.end + 1):
                moved, turned = transforms.distance(poses[-1], rows[k])
                if moved >= POSITION_STEP or turned >= ROTATION_STEP or k == kept.end:
                    poses.append(rows[k])
            marks.append(len(poses) - 1)
        if _alike(poses[-1], self._plan.scene.goal.pose):
            poses[-1] = self._plan.scene.goal.pose
        return np.array(poses), np.array(marks, int)

    # contacts

    def _with_tool(self, kept: KeptSegment) -> bool:
        return kept.segment.manipulator in self._plan.scene.bodies

    def _kept_here(self, object_poses: np.ndarray) -> tuple[KeptSegment, int] | None:
        """The old contact at the object's present pose, and the index of the pose where it ended."""
        rows = self._plan.trajectory.objects[self._object]
        for kept in self._segments:
            if self._with_tool(kept):
                continue
            moved, turned = transforms.distance(rows[max(kept.begin, self._at)], object_poses[0])
            if moved > NEAR or turned > NEAR_TURN:
                continue
            reach = int(np.linalg.norm(object_poses[:, :3] - rows[kept.end, :3], axis=1).argmin())
            if reach > 0 and _alike(object_poses[reach], rows[kept.end]):
                return kept, reach
        return None

    def _contact(
        self, scene: Scene, state: SceneState, kept: KeptSegment, object_poses: np.ndarray
    ) -> RobotContact | None:
        """The old contact for the object's poses (reach + 1, 7), where new bodies leave it free."""
        if not self._free(kept.begin, kept.last):
            return None
        robot = kept.segment.robot
        contact = contact_of(self._plan, kept)
        self._chosen[id(contact)] = kept
        q, rows = self._plan.trajectory.joints[robot], self._plan.trajectory.objects[self._object]
        span = np.arange(max(kept.begin, self._at), kept.end + 1)
        nearest = [span[np.linalg.norm(rows[span, :3] - pose[:3], axis=1).argmin()] for pose in object_poses]
        return RobotContact(robot, contact, len(nearest) - 1, q[nearest], away_from_home(scene, state, robot))

    def _known(self, scene: Scene, state: SceneState, object_poses, robots, seed: int) -> list[RobotContact]:
        """The old contacts that carry the object far enough along its poses (M, 7), the farthest-reaching first."""
        rng = np.random.default_rng(seed)
        found: list[RobotContact] = []
        for robot in dict.fromkeys(kept.segment.robot for kept in self._by_hand):
            if robot in robots:
                points = [contact_of(self._plan, kept) for kept in self._by_hand if kept.segment.robot == robot]
                found += self.check_contacts(scene, state, self._object, object_poses, robot, points, rng)
        enough = SERVES * (len(object_poses) - 1)
        return sorted((c for c in found if c.reach >= enough), key=lambda contact: -contact.reach)

    # motions

    def _continues(self, state: SceneState, kept: KeptSegment, object_poses: np.ndarray) -> bool:
        """Whether robots, grippers and object stand as the plan has them when the robot sets out."""
        old = self._plan.trajectory
        if kept.first < self._at:
            return False
        joints = all(np.abs(state.q[name] - q[kept.first]).max() <= SAME_JOINT for name, q in old.joints.items())
        openings = all(abs(state.gripper[name] - o[kept.first]) <= SAME_OPENING for name, o in old.gripper.items())
        moved, turned = transforms.distance(old.objects[self._object][kept.first], state.poses[self._object])
        ends = _alike(old.objects[self._object][kept.end], object_poses[-1])
        return joints and openings and moved <= SAME and turned <= SAME_TURN and ends

    def _motion(self, state: SceneState, kept: KeptSegment) -> SegmentMotion:
        old, rows = self._plan.trajectory, slice(kept.first, kept.last + 1)
        start, end = old.time[kept.first], old.time[kept.last]
        segments = tuple(
            replace(s, start=max(s.start, start) - start, end=min(s.end, end) - start)
            for s in self._plan.segments
            if s.end > start + 1e-9 and s.start < end - 1e-9
        )
        trajectory = Trajectory(
            old.time[rows] - start,
            {name: q[rows] for name, q in old.joints.items()},
            {name: opening[rows] for name, opening in old.gripper.items()},
            {self._object: old.objects[self._object][rows]},
        )
        return SegmentMotion(trajectory, segments)

    def _free(self, first: int, last: int) -> bool:
        time = self._plan.trajectory.time
        start = time[max(first, self._at)]
        return first_conflict(self._plan, self._new, float(start), float(time[last])) is None


def contact_of(plan: Plan, kept: KeptSegment) -> ContactPoint:
    """The contact of a segment; its approach is opposite to how the hand leaves it, or the hand's z axis.

    Where on the surface it touches is not in a plan: point and normal are taken from the end effector.
    """
    T_obj_ee = kept.segment.contact_pose
    arm = load_arm(plan.scene.robots[kept.segment.robot].model)
    q = plan.trajectory.joints[kept.segment.robot]
    leaving = transforms.multiply(transforms.inverse(arm.end_effector(q[kept.end])), arm.end_effector(q[kept.last]))
    length = float(np.linalg.norm(leaving[:3]))
    approach = -leaving[:3] / length if length > STANDS else np.array([0.0, 0.0, 1.0])
    R = transforms.rotation_matrix(T_obj_ee)
    return ContactPoint(
        kind=ContactKind(kept.segment.kind.value),
        T_obj_ee=T_obj_ee,
        point=T_obj_ee[:3],
        normal=-R @ approach,
        opening=float(plan.trajectory.gripper[kept.segment.robot][kept.begin]),
        approach=approach,
    )


def _alike(T_a: np.ndarray, T_b: np.ndarray) -> bool:
    return max(transforms.distance(T_a, T_b)) <= ALIKE


def _denser(poses: np.ndarray, step: float = 0.005) -> np.ndarray:
    """Poses (K, 7) along the path at most about ``step`` metres apart."""
    parts = []
    for a, b in zip(poses, poses[1:], strict=False):
        moved, turned = transforms.distance(a, b)
        count = max(1, int(np.ceil(max(moved / step, turned / ROTATION_STEP * 2.0))))
        parts.append(transforms.interpolate(a, b, np.linspace(0.0, 1.0, count, endpoint=False)))
    return np.concatenate([*parts, poses[-1:]])
