"""Plan repair: a plan that is blocked ahead is kept where it is free, and only the rest is planned anew.

The plan is cut into subgoals between which all hands are free. For each, the strategies of
:mod:`hmap_core.planner.strategies.repair` are tried, the cheapest first: keep it as it was, plan only the way to its
contact, keep contact and object path, find another contact or path, or run Algorithm 1 for this subgoal.

The judge checks what is new. It has accepted the rest before, and that is checked against the new bodies.
"""

import time
from dataclasses import replace

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, HmapError, MotionError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner.assembly import assemble, scene_at, state_after
from hmap_core.planner.conflicts import first_conflict, unknown_bodies
from hmap_core.planner.hmap_planner import HmapPlanner, PlanningJob
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.obstacle_removal import raise_if_final
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.planned_contacts import PlannedContact
from hmap_core.planner.planned_subgoals import PlannedSubgoal, planned_subgoals
from hmap_core.planner.protocols import SegmentQuery
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.strategies.repair import REHEARSED, REPAIR_STRATEGIES
from hmap_core.planner.strategies.repair.base import RepairTask
from hmap_core.trajectory.samples import index_at, state_at
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Goal, Plan, Scene, SceneState, Shape, ShapeKind, Trajectory
from hmap_core.validation import check

SAME, SAME_TURN = 1e-4, 1e-3  # m, rad: an object stands where the plan has it
SAME_JOINT = 1e-3  # rad: so does a robot
SAME_OPENING = 1e-3  # m: so does a gripper
REHEARSED_RADIUS = 0.02  # m


class PlanRepair:
    """One attempt at repairing a plan.

    Attributes:
        plan: the old plan.
        at: the sample up to which it was followed.
        scene: as it is now.
        ahead: subgoals that are not finished.
        job: the limits of the new plan and the components that work for it.
        kept: how many subgoals were kept as they were (``motions``), but for the way to their contact (``work``), with
            their contact and path (``contacts``); how many are done in one other contact (``paths``), and how many by
            Algorithm 1 (``planned``).
    """

    def __init__(self, job: PlanningJob, plan: Plan, at: float):
        """
        Args:
            job: with the scene and the state as they are now.
            plan: the old plan.
            at: planned time (s) up to which it was followed.
        """
        self.job, self.plan = job, plan
        self.at = index_at(plan.trajectory.time, at)
        self.scene: Scene = job.scene
        self._new = unknown_bodies(plan, self.scene.bodies)
        self.ahead = [subgoal for subgoal in planned_subgoals(plan) if subgoal.contacts[-1].end > self.at]
        self.kept = {"motions": 0, "work": 0, "contacts": 0, "paths": 0, "planned": 0}

    def repair(self) -> Plan:
        """Repair the plan.

        Raises:
            PlannerError: it cannot be repaired.
            HmapError: the error of the subgoal that failed.
        """
        if not self.ahead:
            raise PlannerError("nothing of the old plan is left", Code.NO_MOTION)
        began = time.thread_time()
        sequence = SolutionSequence(self.job.start)
        unjudged: list[tuple[SceneState, tuple[SubTrajectory, ...]]] = []
        for subgoal in self.ahead:
            outcome = self._solve(RepairTask(self, subgoal, sequence))
            if isinstance(outcome, Failure):
                raise outcome.error or PlannerError(outcome.reason, outcome.code)
            unjudged += outcome.unjudged
            sequence = outcome.sequence
        self._check_goal(sequence.state)
        planning_time = time.monotonic() - self.job.context.budget.began
        planning_cpu = time.thread_time() - began
        for before, motions in unjudged:
            self._judge(before, motions)
        goal = self.scene.goal
        stats = {
            "planning_time_s": planning_time,
            "planning_cpu_s": planning_cpu,
            "waypoints": len(self.ahead),
            "contacts": sum(len(subgoal.contacts) for subgoal in self.ahead),
            "mode_switches": sum(len(motion.segments) for motion in sequence.motions) - 1,
            **self.job.noted(),
        }
        return assemble(self.scene, self.job.start, sequence.motions, goal.pose[None], stats)

    def _solve(self, task: RepairTask) -> Outcome:
        outcome: Outcome = Failure("planner", Code.NO_MOTION, "nothing of the old plan serves any more")
        for strategy in REPAIR_STRATEGIES:
            if not strategy.applies(task):
                continue
            outcome = strategy.solve(self.job.search, task)
            if isinstance(outcome, Solution):
                self.kept[strategy.kept] += 1
                break
        return outcome

    # what strategies need to know of the old plan

    def by_tool(self, contact: PlannedContact) -> bool:
        """Whether a tool makes a contact of the plan."""
        return contact.segment.manipulator in self.plan.scene.bodies

    def robots_as_planned(self, state: SceneState, sample: int) -> bool:
        """Whether robots and grippers are as the plan has them at a sample."""
        old = self.plan.trajectory
        joints = all(np.abs(state.q[name] - q[sample]).max() <= SAME_JOINT for name, q in old.joints.items())
        return joints and all(abs(state.gripper[n] - o[sample]) <= SAME_OPENING for n, o in old.gripper.items())

    def objects_as_planned(self, subgoal: PlannedSubgoal, state: SceneState) -> bool:
        """Whether what a subgoal moves stands where the plan picks it up."""
        old = self.plan.trajectory.objects
        off = (transforms.distance(old[name][subgoal.first], state.poses[name]) for name in subgoal.bodies)
        return all(moved <= SAME and turned <= SAME_TURN for moved, turned in off)

    def is_free(self, subgoal: PlannedSubgoal, state: SceneState, first: int, last: int, robots=None) -> bool:
        """Whether a part of a subgoal, from one sample to another, is clear of bodies that the plan does not know.

        Args:
            subgoal: the subgoal.
            state: where everything is.
            first, last: samples.
            robots: names of those that are checked; None: all.
        """
        around, span = self.around(subgoal, state), self.span(first, last)
        return first_conflict(self.plan, around, *span, sorted(subgoal.bodies), robots) is None

    def around(self, subgoal: PlannedSubgoal, state: SceneState) -> dict[str, Body]:
        """The bodies that the plan does not know, or has elsewhere, but for those of the subgoal itself."""
        found, old = dict(self._new), self.plan.trajectory.objects
        for name, rows in old.items():
            moved, turned = transforms.distance(rows[subgoal.first], state.poses[name])
            if name not in subgoal.bodies and (moved > SAME or turned > SAME_TURN):
                found[name] = replace(self.scene.bodies[name], pose=state.poses[name])
        return found

    def span(self, first: int, last: int) -> tuple[float, float]:
        """The planned times (s) of two samples."""
        times = self.plan.trajectory.time
        return float(times[first]), float(times[last])

    @property
    def period(self) -> float:
        """Time between two samples of the plan, s."""
        times = self.plan.trajectory.time
        return float(times[1] - times[0])

    def goal_of(self, subgoal: PlannedSubgoal) -> Goal:
        """The body that a subgoal is about, and where it brings it."""
        tools = {name for name, body in self.scene.bodies.items() if body.kind is BodyKind.TOOL}
        handled = [contact.segment.contact_object for contact in subgoal.contacts]
        name = next((other for other in reversed(handled) if other not in tools), handled[-1])
        end, own = self.plan.trajectory.objects[name][subgoal.last], self.scene.goal
        reaches = name == own.object and transforms.distance(end, own.pose)[0] <= SAME
        return own if reaches else Goal(name, end)

    def copied(self, subgoal: PlannedSubgoal, first: int) -> SubTrajectory:
        """Samples of the old plan from ``first`` to the end of a subgoal."""
        old, rows = self.plan.trajectory, slice(first, subgoal.last + 1)
        start, end = self.span(first, subgoal.last)
        segments = tuple(
            replace(s, start=max(s.start, start) - start, end=min(s.end, end) - start)
            for s in self.plan.segments
            if s.end > start + 1e-9 and s.start < end - 1e-9
        )
        trajectory = Trajectory(
            old.time[rows] - start,
            {name: q[rows] for name, q in old.joints.items()},
            {name: opening[rows] for name, opening in old.gripper.items()},
            {name: old.objects[name][rows] for name in subgoal.bodies},
        )
        return SubTrajectory(trajectory, segments)

    def motion(self, state: SceneState, name: str, contact: RobotContact, poses: np.ndarray) -> SubTrajectory | None:
        """The motion in which a contact carries an object along poses (M, 7); None where there is none."""
        context = self.job.context
        query = SegmentQuery(self.scene, state, name, contact, poses, context.seed(), self.time_left())
        try:
            return context.components.segments.plan_segment(query)
        except MotionError:
            return None

    def time_left(self) -> float:
        """Seconds left; negative where there are none."""
        return self.job.context.budget.deadline - time.monotonic()

    # what is new has to be valid

    def _check_goal(self, state: SceneState) -> None:
        goal = self.scene.goal
        moved, turned = transforms.distance(state.poses[goal.object], goal.pose)
        if moved > goal.position_tolerance or turned > goal.rotation_tolerance:
            raise PlannerError(f"'{goal.object}' would end {moved:.3f} m from its goal", Code.NO_MOTION)

    def _judge(self, state: SceneState, motions: tuple[SubTrajectory, ...]) -> None:
        """Raise PlannerError if the judge does not accept motions from a state."""
        scene, after = scene_at(self.scene, state), state
        for motion in motions:
            after = state_after(after, motion)
        name = next((s.object for s in motions[-1].segments if s.object is not None), scene.goal.object)
        scene = scene.with_goal(replace(scene.goal, object=name, pose=after.poses[name]))
        report = check(to_dict(assemble(scene, state, motions, np.zeros((0, 7)), {})), self.time_left)
        if not report.valid:
            worst = report.violations[0]
            raise PlannerError(
                f"the judge rejects what is new: {worst.kind} of {', '.join(worst.bodies)} at {worst.time:.2f} s, "
                f"{worst.amount:.4g} where {worst.limit:.4g} is allowed",
                Code.PLAN_REJECTED,
            )


def plan_anew(
    plan: Plan, at: float, scene: Scene, state: SceneState, seed: int, planner: HmapPlanner | None = None, **limits
) -> tuple[Plan, dict[str, int]]:
    """A plan in place of one that is blocked: the old one repaired, or another one by Algorithm 1.

    Args:
        plan: the old plan.
        at: planned time (s) up to which it was followed.
        scene, state: as they are now.
        seed: the only source of randomness.
        planner: with the components that work for it; by default those of this process.
        limits: ``time_limit``, ``progress`` and ``cancel`` of :meth:`HmapPlanner.plan`.

    Returns:
        The plan, and what was kept of the old one, as :attr:`PlanRepair.kept`; empty if it was not repaired.

    Raises:
        HmapError: as :meth:`HmapPlanner.plan`.
    """
    planner = planner or HmapPlanner()
    began = time.monotonic()
    repair = PlanRepair(PlanningJob(planner, scene, state, seed, began=began, **limits), plan, at)
    try:
        return repair.repair(), repair.kept
    except HmapError as error:
        raise_if_final(error)
    return PlanningJob(planner, scene, state, seed, began=began, **limits).plan(), {}


def rehearse(plan: Plan, time_limit: float) -> None:
    """Run plan repair once and forget the result, so that all code is loaded when it matters.

    The last subgoal is repaired with the way free, and with a ball in the middle of it.
    """
    subgoals = planned_subgoals(plan)
    if not subgoals:
        return
    subgoal = subgoals[-1]
    state = state_at(plan, subgoal.first)
    rows = plan.trajectory.objects[subgoal.contacts[-1].segment.contact_object]
    middle = pose(rows[(subgoal.begin + subgoal.contacts[-1].end) // 2, :3])
    ball = Body("", BodyKind.FIXED, (Shape(ShapeKind.SPHERE, (REHEARSED_RADIUS,)),), middle)
    for bodies in {}, {ball.name: ball}:
        scene = replace(plan.scene, bodies=plan.scene.bodies | bodies)
        there = replace(state, poses=state.poses | {name: body.pose for name, body in bodies.items()})
        job = PlanningJob(HmapPlanner(), scene, there, time_limit=time_limit)
        repair = PlanRepair(job, plan, float(plan.trajectory.time[subgoal.first]))
        task = RepairTask(repair, subgoal, SolutionSequence(there))
        for strategy in REHEARSED:
            try:
                strategy.solve(job.search, task)
            except HmapError:
                continue
