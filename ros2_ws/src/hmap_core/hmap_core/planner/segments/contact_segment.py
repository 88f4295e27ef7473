"""The segment of one robot and one contact: transit, approach, contact and retreat, solved as one problem."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.contacts.feasibility import draw_back, ik_problem
from hmap_core.exceptions import Code, MotionError
from hmap_core.komo.allowances import relaxed, verification
from hmap_core.komo.clearances import VERIFIED_ONLY
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import (
    APPROACH_STEPS,
    Phase,
    approach_skeleton,
    approach_through,
    bit,
    free_opening,
    segment_skeleton,
)
from hmap_core.komo.skeleton import Skeleton
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.segments.attached import end_effector_poses, with_attached
from hmap_core.planner.segments.carried import grasped, pressed, pushed
from hmap_core.planner.segments.object_steps import thinned
from hmap_core.planner.segments.parts import part
from hmap_core.planner.segments.timing import PRESS_SAMPLES, ramp, timed_contact, timed_transit
from hmap_core.planner.segments.transits import path_options, straight, transit_steps
from hmap_core.planner.segments.verification import Masks, executed_spline, find_violations, worst_between_steps
from hmap_core.planner.segments.violation import Part, PathResult, Violation
from hmap_core.planner.transit import find_transit, resampled
from hmap_core.planner.transit_search import FindTransit, TransitSearch
from hmap_core.trajectory.timing import PointLimits
from hmap_core.transforms import consistent, inverse, multiply, multiply_all
from hmap_core.types import ContactKind, Scene, SceneState, SegmentKind

SEARCH_TIME = 10.0  # s that may go into one joint-space search; its number of checks ends it earlier

ProblemOf = Callable[[int], SkeletonProblem]  # the problem for a number of steps of the transit


class CutCorner(MotionError):
    """The motion is feasible at its steps, but not between those along the object's path.

    Attributes:
        of_object: whether it is the object that comes too close to another body there, whichever contact carries it.
    """

    of_object = False


class ContactSegment:
    """The motion of one robot to a contact, with the object, and away from it.

    Args:
        scene, state: before the segment.
        object: name of the object.
        contact: the robot's contact with it, with configurations at the poses.
        object_poses: (K, 7) its path.
        fineness: share of the usual step along that path.
        find: searches a transit where the optimiser finds none.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        contact: RobotContact,
        object_poses: np.ndarray,
        fineness: float = 1.0,
        find: FindTransit = find_transit,
    ):
        self._find = find
        self.scene, self.state, self.object = scene, state, object
        self.robot, self.contact = contact.robot, contact.contact
        self.manipulation = Manipulation(scene, state, contact.robot, object)
        self.start = state.q[contact.robot]
        self.poses, self.keyframes = thinned(object_poses, contact.keyframes, fineness)
        self.T_start, self.T_end = object_poses[0], object_poses[-1]
        self.collisions: CollisionModel = self.manipulation.collisions(
            self.contact, self.T_start, self.T_end, object_poses
        )

    # --- the motions

    def solve(self, rng: np.random.Generator, deadline: float) -> list[SubTrajectory]:
        """The whole segment.

        Raises:
            MotionError: NO_MOTION; CutCorner where finer steps along the object's path may help.
        """
        before = self._drawn_back(self.T_start, self.keyframes[0], Phase.APPROACH)
        after = self._drawn_back(self.T_end, self.keyframes[-1], Phase.RETREAT)
        make = partial(self.problem, segment_skeleton(self.robot, self.object, self.contact, self.poses))
        return self.trajectories(*self._split(*self._search(make, before, after, rng, deadline)))

    def trajectories(self, coming: np.ndarray, carrying: np.ndarray, leaving: np.ndarray) -> list[SubTrajectory]:
        """The timed motions along the paths (M, n) to the contact, with the object, and away from it.

        Raises:
            MotionError: a point of a path is beyond the joint limits.
        """
        parts = self._coming(coming), self._carrying(carrying), self._leaving(leaving)
        return [with_attached(self.scene, own) for own in parts]

    def come(self, rng: np.random.Generator, deadline: float, exact: bool = False) -> SubTrajectory:
        """The transit to the contact and the closing of the gripper alone; ``exact``: just as in the keyframe.

        Raises:
            MotionError: NO_MOTION.
        """
        before = self._drawn_back(self.T_start, self.keyframes[0], Phase.APPROACH)
        if exact:
            skeleton = approach_through(self.robot, np.array([*before[::-1], self.keyframes[0]]))
        else:
            skeleton = approach_skeleton(self.robot, self.object, self.contact, self.T_start)
        _, path = self._search(partial(self.problem, skeleton), before, self.keyframes[:0], rng, deadline)
        return self._coming(np.concatenate([self.start[None], path]))

    def leave(self) -> SubTrajectory:
        """The opening of the gripper and the retreat alone, from where the robot is.

        Raises:
            MotionError: NO_MOTION.
        """
        after = self._drawn_back(self.T_end, self.start, Phase.RETREAT)
        path = np.concatenate([self.start[None], after])
        cols, masks = verification(self.collisions.arrays()), Masks(bit(Phase.RETREAT))
        chain = self.manipulation.model.chain
        amount, pair = worst_between_steps(chain, cols, executed_spline(chain, path), masks)
        if pair >= 0:
            violation = Violation(Part.LEAVING, amount, self.collisions.pair_name(pair))
            raise MotionError(f"robot '{self.robot}' cannot let '{self.object}' go: {violation}")
        return self._leaving(path)

    # --- the problems

    def problem(self, skeleton: Skeleton, transit_steps: int) -> SkeletonProblem:
        """The problem of a skeleton of the segment, or of its first phases, with so many steps of the transit."""
        steps = (transit_steps, APPROACH_STEPS, len(self.poses) - 1, APPROACH_STEPS)[: skeleton.phases]
        options = path_options(sum(steps))
        return self.manipulation.problem(skeleton, steps, options, self.T_start, self.collisions)

    # --- the search for a path

    def _search(
        self, make: ProblemOf, before: np.ndarray, after: np.ndarray, rng: np.random.Generator, deadline: float
    ) -> tuple[SkeletonProblem, np.ndarray]:
        """The verified path (T, n) and its problem: from the straight transit to the contact or from one by search.

        A transit with room round what is attached comes first. What was found by search is used as it is where the
        optimiser, which smooths it, makes it collide or uses up the room.
        """
        steps, mask = transit_steps(self.start, before[-1]), bit(Phase.TRANSIT)
        problem = make(steps)
        cols = relaxed(problem.chain, problem.arrays(), self.start, mask)
        search = TransitSearch(self.manipulation, self.collisions, cols, self.start, before[-1], mask, self._find)
        until = min(deadline, time.monotonic() + SEARCH_TIME)
        result = self._solved(problem, cols, straight(self.start, before[-1], steps), before, after)
        found = result.path
        if found is not None and search.has_room(np.concatenate([self.start[None], found[:steps]])):
            return problem, found
        what = "cannot get to the contact on"
        cut_corner = result.collides_first(Part.CARRYING)
        for way in search.ways(rng, until, found is None) if not cut_corner else ():
            what = "finds no motion with its contact on"
            result = self._solved(problem, cols, resampled(way, steps), before, after)
            if result.path is not None and search.has_room(np.concatenate([self.start[None], result.path[:steps]])):
                return problem, result.path
            found = result.path if found is None else found
            if not result.collides_first(Part.CARRYING):
                fine, path = make(len(way) - 1), self._guess(way[1:], before, after)
                result = PathResult(violations=self._check(fine, path, cols))
                if not result.violations:
                    return fine, path
            cut_corner = result.collides_first(Part.CARRYING)
            if cut_corner:
                break
        if found is None:
            reason = f"robot '{self.robot}' {what} '{self.object}': {result.why}"
            if not cut_corner:
                raise MotionError(reason)
            error = CutCorner(reason)
            error.of_object = self.scene.bodies.keys() >= set(result.violations[0].pair)
            raise error
        return problem, found

    def _solved(
        self, problem: SkeletonProblem, cols: Collisions, transit: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> PathResult:
        """The verified path from one first guess of the transit (T0, n)."""
        result = problem.solve(self.start, self._guess(transit, before, after))
        if not result.feasible:
            return PathResult(unsolved=result.worst)
        path = result.path
        violations = self._check(problem, path, cols)
        if violations and PathResult(violations=violations).collides_first(Part.LEAVING):
            path = self._leaving_straight(problem, path)
            violations = self._check(problem, path, cols)
        return PathResult(violations=violations) if violations else PathResult(path)

    def _leaving_straight(self, problem: SkeletonProblem, path: np.ndarray) -> np.ndarray:
        """The path (T, n) with its retreat anew from where it lets go.

        The smoothest retreat goes on as the joints moved before, if need be through another configuration of the arm.
        """
        end = problem.last(Phase.HOLD)
        retreating = ik_problem(self.manipulation, self.collisions, Phase.RETREAT)
        after = draw_back(self.manipulation, retreating, self.contact, self.T_end, path[end])
        return np.concatenate([path[: end + 1], after]) if len(after) else path

    def _guess(self, transit: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """The path (T, n) after the start: a transit (T0, n), then the known configurations of the other phases."""
        return np.concatenate([transit, before[-2::-1], self.keyframes, after])

    def _drawn_back(self, T_world_obj: np.ndarray, q: np.ndarray, phase: Phase) -> np.ndarray:
        problem = ik_problem(self.manipulation, self.collisions, phase)
        path = draw_back(self.manipulation, problem, self.contact, T_world_obj, q)
        if not len(path):
            what = "come to" if phase == Phase.APPROACH else "leave"
            raise MotionError(f"robot '{self.robot}' cannot {what} the contact on '{self.object}'", Code.NO_MOTION)
        return path

    # --- verification

    def _split(self, problem: SkeletonProblem, path: np.ndarray) -> list[np.ndarray]:
        """The coming (M0, n), carrying (M1, n) and leaving (M2, n) parts; each starts where the last ended."""
        contact, end = problem.last(Phase.APPROACH), problem.last(Phase.HOLD)
        coming = np.concatenate([self.start[None], path[: contact + 1]])
        return [coming, path[contact : end + 1], path[end:]]

    def _check(self, problem: SkeletonProblem, path: np.ndarray, cols: Collisions) -> tuple[Violation, ...]:
        """What a path (T, n) violates between its steps."""
        own = zip(Part, self._split(problem, path), strict=True)
        chain = problem.chain
        curves = {name: executed_spline(chain, steps) for name, steps in own if name is Part.COMING or len(steps) > 1}
        knots = curves[Part.COMING].x
        turn = knots[-1 - APPROACH_STEPS] if len(knots) > APPROACH_STEPS else 0.0
        masks = {
            Part.COMING: Masks(bit(Phase.TRANSIT), turn, bit(Phase.APPROACH)),
            Part.CARRYING: Masks(bit(Phase.HOLD) | VERIFIED_ONLY),
            Part.LEAVING: Masks(bit(Phase.RETREAT)),
        }
        parts = {name: (curve, masks[name]) for name, curve in curves.items()}
        return find_violations(chain, self.collisions, verification(cols), parts)

    # --- trajectories

    def _openings(self) -> tuple[float, float]:
        """Of the gripper in transit, approach and retreat, and in contact, m."""
        robot = self.scene.robots[self.robot]
        free = free_opening(robot, self.contact)
        return free, free if robot.model.attached else self.contact.opening

    def _ramp(self, a: float, b: float) -> np.ndarray:
        return ramp(self.scene.robots[self.robot].model.gripper, a, b)

    def _coming(self, path: np.ndarray) -> SubTrajectory:
        free, closed = self._openings()
        q = timed_transit(self.scene, self.robot, path)
        opening, closing = self._ramp(self.state.gripper[self.robot], free), self._ramp(free, closed)
        coming = np.concatenate([np.repeat(q[:1], len(opening), 0), q, np.repeat(q[-1:], len(closing), 0)])
        return part(self.scene, self.robot, coming, np.concatenate([opening, np.full(len(q), free), closing]))

    def _carrying(self, path: np.ndarray) -> SubTrajectory:
        """The object hangs on the hand as they meet at the start, which is the contact within what KOMO leaves open."""
        T_obj_ee = multiply(inverse(self.T_start), end_effector_poses(self.scene, self.robot, path[:1])[0])
        q = timed_contact(self.scene, self.robot, path, self._limits(inverse(T_obj_ee)))
        force = None
        if self.contact.kind == ContactKind.PRESS:
            force = self.contact.force
            q = np.concatenate([np.repeat(q[:1], PRESS_SAMPLES, 0), q, np.repeat(q[-1:], PRESS_SAMPLES, 0)])
        T_ee = end_effector_poses(self.scene, self.robot, q)
        moved = {self.object: consistent(multiply_all(T_ee, inverse(T_obj_ee)))}
        opening, kind = np.full(len(q), self._openings()[1]), SegmentKind(self.contact.kind.value)
        return part(self.scene, self.robot, q, opening, kind, self.object, T_obj_ee, moved, force)

    def _limits(self, T_ee_obj: np.ndarray) -> PointLimits:
        """Of the object that the robot has at T_ee_obj (7,)."""
        if self.contact.kind == ContactKind.PUSH:
            return pushed(self.scene, self.robot, self.object, T_ee_obj)
        if self.contact.kind == ContactKind.PRESS:
            return pressed(self.scene, self.robot, self.object, T_ee_obj)
        return grasped(self.scene, self.robot, self.scene.bodies[self.object], T_ee_obj, self.contact.opening)

    def _leaving(self, path: np.ndarray) -> SubTrajectory:
        free, closed = self._openings()
        q = timed_transit(self.scene, self.robot, path)
        released = self._ramp(closed, free)
        leaving = np.concatenate([np.repeat(q[:1], len(released), 0), q])
        return part(self.scene, self.robot, leaving, np.concatenate([released, np.full(len(q), free)]))
