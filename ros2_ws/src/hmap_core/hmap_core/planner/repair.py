"""A plan that is blocked ahead, mended: what is free of the new bodies is followed as it was, only the rest is sought.

A plan is cut into subgoals, between which all hands are free. An subgoal that stays clear and begins as planned is
taken
over as it is. Where only the way to its contact is blocked, or begins elsewhere, that way alone is planned anew. Where
the hand is in the way, or the object stands a little off, the subgoal is optimised anew with the same contact and the
same path of the object. What cannot be mended like that is planned anew by Algorithm 1, for this one subgoal.

The judge looks at what is new. What was taken over it has accepted before, and it is checked against the new bodies.
"""

import time
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, HmapError, MotionError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner import segments
from hmap_core.planner.algorithm import Planner, nearest_first
from hmap_core.planner.assembly import assemble, scene_at, state_after
from hmap_core.planner.attached_path import attached_paths
from hmap_core.planner.conflicts import first_conflict, unknown_bodies
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.local import away_from_home, contact_score
from hmap_core.planner.obstacle_removal import SolutionSequence, Subgoal, raise_if_final
from hmap_core.planner.planned_contacts import PlannedContact, contact_of, planned_contacts
from hmap_core.trajectory.measured import upright
from hmap_core.trajectory.samples import index_at, state_at
from hmap_core.transforms import pose
from hmap_core.types import (
    Body,
    BodyKind,
    Goal,
    Plan,
    Scene,
    SceneState,
    Segment,
    SegmentKind,
    Shape,
    ShapeKind,
    Trajectory,
)
from hmap_core.validation import check

POSITION_STEP, ROTATION_STEP = 0.01, float(np.deg2rad(3.0))  # m, rad between kept poses of an object
NEAR, NEAR_TURN = 0.01, float(np.deg2rad(5.0))  # m, rad off its path at which it is still taken up
SAME, SAME_TURN = 1e-4, 1e-3  # m, rad: an object stands where the plan has it
SAME_JOINT = 1e-3  # rad: so does a robot
SAME_OPENING = 1e-3  # m: so does a gripper
ATTACHED_CHECKS = 500  # motions checked for a path of an object in a hand; what is found there mostly takes none
PATH_CHECKS = 20_000  # motions checked for another path of an object; what is found takes below 1000
CONTACTS = 2  # looked for, and tried, on a path
REST = 3  # samples at rest in a contact, with which the judge is shown a way to it
REHEARSED_RADIUS = 0.02  # m
MAX_SEED = 2**31 - 1


@dataclass(frozen=True)
class PlannedSubgoal:
    """A part of a plan that begins and ends with free hands.

    Attributes:
        contacts: in it, one after the other; with a tool there are several.
    """

    contacts: tuple[PlannedContact, ...]

    @property
    def first(self) -> int:
        """The sample at which it begins."""
        return self.contacts[0].first

    @property
    def begin(self) -> int:
        """The sample at which its first contact is made."""
        return self.contacts[0].begin

    @property
    def last(self) -> int:
        """The sample at which the hand is back."""
        return self.contacts[-1].last

    @property
    def alone(self) -> PlannedContact | None:
        """Its contact, where it has one only."""
        return self.contacts[0] if len(self.contacts) == 1 else None

    @property
    def bodies(self) -> set[str]:
        """What it moves."""
        return {kept.segment.object for kept in self.contacts}


def planned_subgoals(plan: Plan) -> list[PlannedSubgoal]:
    """The subgoals of a plan in their order."""
    handled = dict.fromkeys(segment.object for segment in plan.segments if segment.object is not None)
    contacts = sorted((kept for name in handled for kept in planned_contacts(plan, name)), key=lambda kept: kept.begin)
    groups: list[list[PlannedContact]] = []
    for kept in contacts:
        if groups and kept.begin <= groups[-1][-1].last:
            groups[-1].append(kept)
        else:
            groups.append([kept])
    starts = [0, *(group[-1].last for group in groups)]
    return [
        PlannedSubgoal((replace(group[0], first=max(start, group[0].first)), *group[1:]))
        for start, group in zip(starts, groups, strict=False)
    ]


class Repair:
    """One attempt at mending a plan.

    Attributes:
        kept: how many subgoals were taken over as they were (``motions``), but for the way to their contact (``work``),
            with their contact and path (``contacts``); how many are done in one other contact (``paths``), and how many
            by Algorithm 1 (``planned``).
    """

    def __init__(self, planner: Planner, plan: Plan, at: float):
        """
        Args:
            planner: with the scene, the state and the limits of the new plan; its backend does what is sought anew.
            plan: the old plan.
            at: planned time (s) up to which it was followed.
        """
        self._planner, self._plan = planner, plan
        self._at = index_at(plan.trajectory.time, at)
        self._scene: Scene = planner.scene
        self._new = unknown_bodies(plan, self._scene.bodies)
        self._ahead = [subgoal for subgoal in planned_subgoals(plan) if subgoal.contacts[-1].end > self._at]
        self.kept = {"motions": 0, "work": 0, "contacts": 0, "paths": 0, "planned": 0}

    def plan(self) -> Plan:
        """The mended plan.

        Raises:
            HmapError: it cannot be mended; the reason is that of the part that failed.
        """
        ahead = self._ahead
        if not ahead:
            raise PlannerError("nothing of the old plan is left", Code.NO_MOTION)
        began = time.thread_time()
        state, motions, shown = self._planner.start, [], []
        ways = self.taken_over, self.with_new_way, self.with_its_contact, self.in_one_contact, self.planned
        for subgoal in ahead:
            for solve in ways:
                found = solve(subgoal, state)
                if found is not None:
                    break
            for part in found:
                if part.shown:
                    shown.append((state, part.shown))
                motions.append(part.motion)
                state = state_after(state, part.motion)
        self._check_goal(state)
        planning_time, planning_cpu = time.monotonic() - self._planner.began, time.thread_time() - began
        for before, parts in shown:
            self._judge(before, parts)
        goal = self._scene.goal
        stats = {
            "planning_time_s": planning_time,
            "planning_cpu_s": planning_cpu,
            "waypoints": len(ahead),
            "contacts": sum(len(subgoal.contacts) for subgoal in ahead),
            "mode_switches": sum(len(part.segments) for part in motions) - 1,
        }
        return assemble(self._scene, self._planner.start, motions, goal.pose[None], stats)

    # the ways in which an subgoal goes on, the cheapest first

    def taken_over(self, subgoal: PlannedSubgoal, state: SceneState) -> "list[_Part] | None":
        """As it was, where it begins in this state and is free."""
        if (
            subgoal.first < self._at
            or not self._stands(state, subgoal.first)
            or not self._objects_stand(subgoal, state)
        ):
            return None
        if not self._free(subgoal, state, subgoal.first, subgoal.last):
            return None
        self.kept["motions"] += 1
        return [_Part(self._copied(subgoal, subgoal.first))]

    def with_new_way(self, subgoal: PlannedSubgoal, state: SceneState) -> "list[_Part] | None":
        """As it was, but for the way to its contact."""
        kept = subgoal.contacts[0]
        if subgoal.begin < self._at or not self._objects_stand(subgoal, state):
            return None
        if not self._free(subgoal, state, subgoal.begin, subgoal.last):
            return None
        robot = kept.segment.robot
        q = self._plan.trajectory.joints[robot][kept.begin]
        away = away_from_home(self._scene, state, robot)
        contact = RobotContact(robot, contact_of(self._plan, kept), 0, q[None], away)
        try:
            way = segments.come(self._scene, state, contact, kept.segment.object, self._rng(), self._time_left())
        except MotionError:
            return None
        arrived = state_after(state, way)
        if not self._stands(arrived, subgoal.begin):
            return None
        self.kept["work"] += 1
        held = _at_rest(arrived, kept.segment, self._period)
        return [_Part(way, (way, held)), _Part(self._copied(subgoal, subgoal.begin))]

    def with_its_contact(self, subgoal: PlannedSubgoal, state: SceneState) -> "list[_Part] | None":
        """With the same contact along the same path of the object, from where that stands now."""
        old, kept = self._old_path(subgoal, state), subgoal.alone
        if old is None:
            return None
        ahead, poses = old
        robot = kept.segment.robot
        q, away = self._plan.trajectory.joints[robot][ahead], away_from_home(self._scene, state, robot)
        contact = RobotContact(robot, contact_of(self._plan, kept), len(poses) - 1, q, away)
        request = self._scene, state, kept.segment.object, poses, robot, [contact.contact], len(poses) - 2
        if not self._planner.backend.promising_contacts(*request):  # the hand alone cannot follow any more
            return None
        found = self._solved(state, kept.segment.object, contact, poses)
        if found is None:
            return None
        self.kept["contacts"] += 1
        return [_Part(found, (found,))]

    def _old_path(self, subgoal: PlannedSubgoal, state: SceneState) -> tuple[np.ndarray, np.ndarray] | None:
        """What is left of the path of an subgoal's object, where it is by hand, in one contact, and free.

        Returns:
            The samples (M,) of the plan, and the poses (M, 7), the first of which is where the object stands; what
            slides stays at the height where it is.
        """
        kept = subgoal.alone
        if kept is None or self._by_tool(kept):
            return None
        name = kept.segment.object
        rows = self._plan.trajectory.objects[name]
        ahead = _steps(rows, max(kept.begin, self._at), kept.end)
        moved, turned = transforms.distance(rows[ahead[0]], state.poses[name])
        if moved > NEAR or turned > NEAR_TURN or len(ahead) < 2:
            return None
        span = self._span(ahead[0], ahead[-1])
        if first_conflict(self._plan, self._around(subgoal, state), *span, [name], robots=()) is not None:
            return None
        here = state.poses[name]
        poses = np.array([here, *(upright(T, here) for T in rows[ahead[1:-1]]), rows[ahead[-1]]])
        return ahead, transforms.consistent(poses)

    def in_one_contact(self, subgoal: PlannedSubgoal, state: SceneState) -> "list[_Part] | None":
        """In one contact all the way, along the old path of the object or another one."""
        name, goal = self._goal(subgoal)
        old = self._old_path(subgoal, state)
        found = None if old is not None else self._in_a_hand(subgoal, state, name, goal)
        if found is not None:
            return found
        others = (path for motion in self._motions() for path in self._other_path(state, name, goal, motion))
        for poses in others if old is None else chain([old[1]], others):
            known = None if old is not None and poses is old[1] else subgoal.alone  # that has been tried
            for contact in self._contacts(known, state, name, poses):
                found = self._solved(state, name, contact, poses)
                if found is not None:
                    self.kept["paths"] += 1
                    return [_Part(found, (found,))]
        return None

    def _in_a_hand(self, subgoal: PlannedSubgoal, state: SceneState, name: str, goal: Goal) -> "list[_Part] | None":
        """In one contact, along a path that is sought for the object and the hand: the old contact's, or others."""
        hands, backend = self._hands(subgoal, state, name, goal), self._planner.backend
        for held in attached_paths(
            backend, self._scene, state, goal, hands, self._rng(), self._time_left(), ATTACHED_CHECKS
        ):
            if held.blockers:
                continue
            request = self._scene, state, name, held.poses, held.robot, [held.contact], self._rng()
            for contact in backend.check_contacts(*request):
                found = self._solved(state, name, contact, held.poses) if contact.reach == len(held.poses) - 1 else None
                if found is not None:
                    self.kept["paths"] += 1
                    return [_Part(found, (found,))]
        return None

    def _hands(self, subgoal: PlannedSubgoal, state: SceneState, name: str, goal: Goal):
        """Robots and their contacts in which they might hold an object all the way: first the old one."""
        kept, backend = subgoal.alone, self._planner.backend
        if kept is not None and kept.segment.kind is not SegmentKind.PUSH and not self._by_tool(kept):
            yield kept.segment.robot, contact_of(self._plan, kept)
        for robot in nearest_first(self._scene, name, state, tuple(self._scene.robots)):
            request = self._scene, state, name, goal.pose, robot, CONTACTS, self._seed()
            for contact in backend.contacts_at_both_ends(*request):
                yield robot, contact

    def _by_tool(self, kept: PlannedContact) -> bool:
        return kept.segment.manipulator in self._plan.scene.bodies

    def _motions(self) -> tuple[str, ...]:
        """How an object may move: where that is open, through the air first, where there is more room."""
        return ("spatial", "planar") if self._scene.motion == "auto" else (self._scene.motion,)

    def _other_path(self, state: SceneState, name: str, goal: Goal, motion: str) -> list[np.ndarray]:
        """A path (M, 7) of an object to its goal, if there is one."""
        request = replace(self._scene, motion=motion), state, name, goal, self._seed(), self._time_left(), PATH_CHECKS
        try:
            return [self._planner.backend.plan_waypoints(*request).poses]
        except HmapError as error:
            raise_if_final(error)
            return []

    def _contacts(
        self, kept: PlannedContact | None, state: SceneState, name: str, poses: np.ndarray
    ) -> list[RobotContact]:
        """Contacts that carry an object along all of its poses (M, 7): the old one where it does, else others."""
        backend, last = self._planner.backend, len(poses) - 1
        if kept is not None and not self._by_tool(kept):
            known = [contact_of(self._plan, kept)]
            request = self._scene, state, name, poses, kept.segment.robot, known, self._rng()
            found = backend.check_contacts(*request)
            if found and found[0].reach == last:
                return found
        for robot in nearest_first(self._scene, name, state, tuple(self._scene.robots)):
            rng, cloud = self._rng(), self._planner.clouds.get(name)
            for batch in backend.candidates(self._scene, state, name, poses, robot, rng, cloud):
                found = backend.check_contacts(self._scene, state, name, poses, robot, batch, rng, last - 1)
                if found or self._time_left() < 0.0:
                    return sorted(found, key=lambda contact: -contact_score(self._scene, contact))[:CONTACTS]
        return []

    def planned(self, subgoal: PlannedSubgoal, state: SceneState) -> "list[_Part]":
        """By Algorithm 1: its object is brought to where the old plan brings it.

        Raises:
            HmapError: that does not work, or it is the task itself, for which there are more ways than this one.
        """
        if subgoal is self._ahead[-1]:
            raise PlannerError("nothing of the old plan serves any more", Code.NO_MOTION)
        solution = self._planner.bring(Subgoal(self._goal(subgoal)[1]), SolutionSequence(state))
        self.kept["planned"] += 1
        return [_Part(part, (part,)) for part in solution.motions]

    def _goal(self, subgoal: PlannedSubgoal) -> tuple[str, Goal]:
        """The body that an subgoal is about, and where it brings it."""
        tools = {name for name, body in self._scene.bodies.items() if body.kind is BodyKind.TOOL}
        handled = [kept.segment.object for kept in subgoal.contacts]
        name = next((other for other in reversed(handled) if other not in tools), handled[-1])
        end, own = self._plan.trajectory.objects[name][subgoal.last], self._scene.goal
        reaches = name == own.object and transforms.distance(end, own.pose)[0] <= SAME
        return name, own if reaches else Goal(name, end)

    def _solved(self, state: SceneState, name: str, contact: RobotContact, poses: np.ndarray) -> SubTrajectory | None:
        request = self._scene, state, name, contact, poses, self._seed(), self._time_left()
        try:
            return self._planner.backend.solve_segment(*request)
        except MotionError:
            return None

    # what is still as planned

    def _stands(self, state: SceneState, sample: int) -> bool:
        """Whether robots and grippers are as the plan has them at a sample."""
        old = self._plan.trajectory
        joints = all(np.abs(state.q[name] - q[sample]).max() <= SAME_JOINT for name, q in old.joints.items())
        return joints and all(abs(state.gripper[n] - o[sample]) <= SAME_OPENING for n, o in old.gripper.items())

    def _objects_stand(self, subgoal: PlannedSubgoal, state: SceneState) -> bool:
        """Whether what an subgoal moves stands where the plan takes it."""
        old = self._plan.trajectory.objects
        off = (transforms.distance(old[name][subgoal.first], state.poses[name]) for name in subgoal.bodies)
        return all(moved <= SAME and turned <= SAME_TURN for moved, turned in off)

    def _around(self, subgoal: PlannedSubgoal, state: SceneState) -> dict[str, Body]:
        """The bodies that the plan does not know, or has elsewhere, but for those of the subgoal itself."""
        found, old = dict(self._new), self._plan.trajectory.objects
        for name, rows in old.items():
            moved, turned = transforms.distance(rows[subgoal.first], state.poses[name])
            if name not in subgoal.bodies and (moved > SAME or turned > SAME_TURN):
                found[name] = replace(self._scene.bodies[name], pose=state.poses[name])
        return found

    def _free(self, subgoal: PlannedSubgoal, state: SceneState, first: int, last: int) -> bool:
        around = self._around(subgoal, state)
        return first_conflict(self._plan, around, *self._span(first, last), sorted(subgoal.bodies)) is None

    def _span(self, first: int, last: int) -> tuple[float, float]:
        time = self._plan.trajectory.time
        return float(time[first]), float(time[last])

    @property
    def _period(self) -> float:
        time = self._plan.trajectory.time
        return float(time[1] - time[0])

    def _seed(self) -> int:
        return int(self._planner.rng.integers(MAX_SEED))

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self._seed())

    def _time_left(self) -> float:
        return self._planner.deadline - time.monotonic()

    def _copied(self, subgoal: PlannedSubgoal, first: int) -> SubTrajectory:
        """Samples of the old plan from ``first`` to the end of an subgoal."""
        old, rows = self._plan.trajectory, slice(first, subgoal.last + 1)
        start, end = self._span(first, subgoal.last)
        segments = tuple(
            replace(s, start=max(s.start, start) - start, end=min(s.end, end) - start)
            for s in self._plan.segments
            if s.end > start + 1e-9 and s.start < end - 1e-9
        )
        trajectory = Trajectory(
            old.time[rows] - start,
            {name: q[rows] for name, q in old.joints.items()},
            {name: opening[rows] for name, opening in old.gripper.items()},
            {name: old.objects[name][rows] for name in subgoal.bodies},
        )
        return SubTrajectory(trajectory, segments)

    # what is new has to be valid

    def _check_goal(self, state: SceneState) -> None:
        goal = self._scene.goal
        moved, turned = transforms.distance(state.poses[goal.object], goal.pose)
        if moved > goal.position_tolerance or turned > goal.rotation_tolerance:
            raise PlannerError(f"'{goal.object}' would end {moved:.3f} m from its goal", Code.NO_MOTION)

    def _judge(self, state: SceneState, motions: tuple[SubTrajectory, ...]) -> None:
        """Raises PlannerError where the judge does not accept motions from a state."""
        scene, after = scene_at(self._scene, state), state
        for part in motions:
            after = state_after(after, part)
        name = next((s.object for s in motions[-1].segments if s.object is not None), scene.goal.object)
        scene = scene.with_goal(replace(scene.goal, object=name, pose=after.poses[name]))
        report = check(to_dict(assemble(scene, state, motions, np.zeros((0, 7)), {})))
        if not report.valid:
            worst = report.violations[0]
            raise PlannerError(
                f"the judge rejects what is new: {worst.kind} of {', '.join(worst.bodies)} at {worst.time:.2f} s, "
                f"{worst.amount:.4g} where {worst.limit:.4g} is allowed",
                Code.PLAN_REJECTED,
            )


@dataclass(frozen=True)
class _Part:
    """A motion, and with what the judge is shown it: nothing where he has seen it."""

    motion: SubTrajectory
    shown: tuple[SubTrajectory, ...] = field(default=())


def _at_rest(state: SceneState, contact: Segment, period: float) -> SubTrajectory:
    """A moment of rest in a contact, in the state in which it was made."""
    time = period * np.arange(REST)
    trajectory = Trajectory(
        time,
        {contact.robot: np.tile(state.q[contact.robot], (REST, 1))},
        {contact.robot: np.full(REST, state.gripper[contact.robot])},
        {contact.object: np.tile(state.poses[contact.object], (REST, 1))},
    )
    return SubTrajectory(trajectory, (replace(contact, start=0.0, end=float(time[-1])),))


def _steps(rows: np.ndarray, first: int, last: int) -> np.ndarray:
    """Samples from ``first`` to ``last`` between which a body at rows (N, 7) moves about a step."""
    poses = rows[first : last + 1]
    moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / POSITION_STEP
    dots = np.abs(np.einsum("ij,ij->i", poses[1:, 3:], poses[:-1, 3:])).clip(0.0, 1.0)
    way = np.concatenate([[0.0], np.cumsum(np.maximum(moved, 2.0 * np.arccos(dots) / ROTATION_STEP))])
    kept = np.searchsorted(way, np.arange(0.0, way[-1]))
    return first + np.unique([0, *kept, last - first])


def plan_anew(
    plan: Plan, at: float, scene: Scene, state: SceneState, seed: int, **options
) -> tuple[Plan, dict[str, int]]:
    """A plan in place of one that is blocked: the old one mended, or where that cannot be, another by Algorithm 1.

    Args:
        plan: the old plan.
        at: planned time (s) up to which it was followed.
        scene, state: as they are now.
        options: of :class:`Planner`.

    Returns:
        The plan, and what was kept of the old one, as :attr:`Repair.kept`; nothing where it was not mended.

    Raises:
        HmapError: as :meth:`Planner.plan`.
    """
    began = time.monotonic()
    repair = Repair(Planner(scene, state, seed, **options), plan, at)
    try:
        return repair.plan(), repair.kept
    except HmapError as error:
        raise_if_final(error)
    new = Planner(scene, state, seed, **options)
    new.began = began
    return new.plan(), {}


def rehearse(plan: Plan, time_limit: float) -> None:
    """Do once what mending a plan takes, and forget it, so that everything has been loaded when it matters.

    The last subgoal is mended with the way free, and with a ball in the middle of it.
    """
    subgoals = planned_subgoals(plan)
    if not subgoals:
        return
    subgoal = subgoals[-1]
    state = state_at(plan, subgoal.first)
    rows = plan.trajectory.objects[subgoal.contacts[-1].segment.object]
    middle = pose(rows[(subgoal.begin + subgoal.contacts[-1].end) // 2, :3])
    ball = Body("", BodyKind.FIXED, (Shape(ShapeKind.SPHERE, (REHEARSED_RADIUS,)),), middle)
    for bodies in {}, {ball.name: ball}:
        scene = replace(plan.scene, bodies=plan.scene.bodies | bodies)
        there = replace(state, poses=state.poses | {name: body.pose for name, body in bodies.items()})
        planner = Planner(scene, there, time_limit=time_limit)
        repair = Repair(planner, plan, float(plan.trajectory.time[subgoal.first]))
        for way in (repair.with_new_way, repair.with_its_contact, repair.in_one_contact):
            try:
                way(subgoal, there)
            except HmapError:
                continue
