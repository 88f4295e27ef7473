"""Hand-over: one robot brings an object to a meeting pose, another one grasps it there and takes it over.

Both hands hold the object for a moment, and both robots stand then. The giver moves the object as an attached body
from its support to the meeting pose, the taker from there to the goal.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.contacts.feasibility import reachable
from hmap_core.exceptions import MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner import segments
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.surroundings import away_from_home
from hmap_core.transforms import apply, from_rpy, multiply
from hmap_core.types import ContactPoint, Scene, SceneState, Segment, SegmentKind

POSES = 64  # meeting poses that are sampled for two robots
ASIDE = 0.15  # m, largest distance of a meeting pose from the middle between the shoulders, along each level axis
HEIGHT = (-0.1, 0.35)  # m over the middle between the shoulders
HANDS_APART = 0.01  # m between the two hands
PAIRS = 3  # pairs of grasps at one meeting pose that are tried


@dataclass(frozen=True)
class Meeting:
    """Where an object changes hands.

    Attributes:
        T: (7,) pose of the object, world frame.
        giver, taker: robots.
        given, taken: their grasps on the object.
    """

    T: np.ndarray
    giver: str
    given: ContactPoint
    taker: str
    taken: ContactPoint


def meetings(
    scene: Scene, ends: tuple[np.ndarray, np.ndarray], giver: GraspSet, taker: GraspSet, rng: np.random.Generator
) -> Iterator[Meeting]:
    """Yield meetings at which the hands alone are free, and apart from each other.

    Args:
        scene: the scene.
        ends: start and goal pose (7,) of the object, world frame.
        giver, taker: grasps of two robots on it.
        rng: the only source of randomness.
    """
    given, taken = np.flatnonzero(giver.serves(ends[0])), np.flatnonzero(taker.serves(ends[1]))
    if not len(given) or not len(taken):
        return
    hands = {name: _hand(scene, name) for name in (giver.robot, taker.robot)}
    for T in _poses(scene, ends, giver.robot, taker.robot, rng):
        first = [giver.contacts[k] for k in given[giver.serves(T)[given]]]
        second = [taker.contacts[k] for k in taken[taker.serves(T)[taken]]]
        pairs = [(a, b) for a in first for b in second]
        far = [-float(np.linalg.norm(a.T_obj_ee[:3] - b.T_obj_ee[:3])) for a, b in pairs]
        found = 0
        for k in np.argsort(far, kind="stable"):
            a, b = pairs[k]
            apart = set_distance(
                hands[giver.robot](a.opening), multiply(T, a.T_obj_ee),
                hands[taker.robot](b.opening), multiply(T, b.T_obj_ee), HANDS_APART,
            )  # fmt: skip
            if apart >= HANDS_APART:
                yield Meeting(T, giver.robot, a, taker.robot, b)
                found += 1
            if found == PAIRS:
                break


def _poses(
    scene: Scene, ends: tuple[np.ndarray, np.ndarray], giver: str, taker: str, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Poses (7,) of an object round the middle between two robots, turned about the vertical from start or goal."""
    shoulders = [
        apply(scene.robots[name].base_pose, load_arm(scene.robots[name].model).p_joint[0]) for name in (giver, taker)
    ]
    middle = 0.5 * (shoulders[0] + shoulders[1])
    for k in range(POSES):
        position = middle + [*rng.uniform(-ASIDE, ASIDE, 2), rng.uniform(*HEIGHT)]
        turn = from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, rng.uniform(-np.pi, np.pi)))
        quaternion = multiply(turn, np.r_[np.zeros(3), ends[k % 2][3:]])[3:]
        yield np.concatenate([position, quaternion])


def _hand(scene: Scene, robot: str):
    arm = load_arm(scene.robots[robot].model)
    return lambda opening: from_hulls(arm.hand(opening))


class HandOverMotions:
    """The motions of one hand-over, one after the other.

    Args:
        context: the job.
        scene: with the object as a body.
        object: its name.
    """

    def __init__(self, context: SearchContext, scene: Scene, object: str):
        self._context, self._scene, self._object = context, scene, object
        self._rng = context.child_rng()

    def plan(self, sequence: SolutionSequence, meeting: Meeting, T_goal: np.ndarray) -> SolutionSequence:
        """The sequence after a hand-over that ends with the object at T_goal (7,).

        Raises:
            MotionError: an arm does not reach one of the poses, or there is no motion.
        """
        scene, object, giver, taker = self._scene, self._object, meeting.giver, meeting.taker
        start = sequence.state.poses[object]
        clear = away_from_home(scene, sequence.state, giver)
        given = replace(self._contact(sequence.state, giver, meeting.given, start), clear=clear)
        meet = self._contact(sequence.state, giver, meeting.given, meeting.T)
        self._contact(sequence.state, taker, meeting.taken, T_goal)
        self._contact(sequence.state, taker, meeting.taken, meeting.T)
        sequence = sequence.after(segments.pick(scene, sequence.state, given, object, self._rng, self._time))
        carrying = segments.attach_body(scene, giver, object, meeting.given, start)
        sequence = self._go(carrying, sequence, giver, meet.keyframes[0])
        T = sequence.state.poses[object]
        taken = self._contact(sequence.state, taker, meeting.taken, T)
        coming = segments.come(scene, sequence.state, taken, object, self._rng, self._time)
        sequence = sequence.after(self._held(coming, giver, meeting.given))
        released = RobotContact(giver, meeting.given, 0, sequence.state.q[giver][None])
        leaving = segments.leave(scene, sequence.state, released, object)
        sequence = sequence.after(self._held(leaving, taker, meeting.taken))
        carrying = segments.attach_body(scene, taker, object, meeting.taken, T)
        sequence = self._go(carrying, sequence, giver, scene.robots[giver].model.home)
        placed = self._contact(sequence.state, taker, meeting.taken, T_goal)
        motion = segments.place(scene, sequence.state, placed, object, T_goal, self._rng, self._time)
        return sequence.after(motion)

    @property
    def _time(self) -> float:
        return self._context.time_left()

    def _go(self, scene: Scene, sequence: SolutionSequence, robot: str, q: np.ndarray) -> SolutionSequence:
        return sequence.after(segments.go(scene, sequence.state, robot, q, self._rng, self._time))

    def _contact(self, state: SceneState, robot: str, contact: ContactPoint, T: np.ndarray) -> RobotContact:
        """A contact with the object at T (7,) and the configuration that reaches it. Raises MotionError."""
        there = state.copy()
        there.poses[self._object] = T
        ok, q = reachable(Manipulation(self._scene, there, robot, self._object), [contact], T, self._rng)
        if not ok[0]:
            place = ", ".join(f"{value:.3f}" for value in T[:3])
            raise MotionError(f"'{robot}' does not reach its grasp on '{self._object}' at ({place})")
        return RobotContact(robot, contact, 0, q)

    def _held(self, motion: SubTrajectory, robot: str, contact: ContactPoint) -> SubTrajectory:
        """A motion during which another robot holds the object still."""
        link, end = self._scene.robots[robot].model.end_effector_link, float(motion.trajectory.time[-1])
        hold = Segment(0.0, end, robot, link, self._object, SegmentKind.GRASP, contact.T_obj_ee)
        return replace(motion, segments=(*motion.segments, hold))
