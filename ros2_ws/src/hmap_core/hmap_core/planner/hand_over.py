"""Hand-over: one robot brings an object to a meeting pose, another one grasps it there and takes it over.

The motions are in :mod:`hmap_core.planner.segments.hand_over`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet
from hmap_core.planner.segments.hand_over import contact_at
from hmap_core.planner.surroundings import away_from_home
from hmap_core.transforms import apply, from_rpy, multiply
from hmap_core.types import ContactPoint, Scene, SceneState

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


def contacts_of(
    scene: Scene, state: SceneState, object: str, meeting: Meeting, T_goal: np.ndarray, rng: np.random.Generator
) -> tuple[RobotContact, RobotContact]:
    """The contacts of a meeting with their configurations: the giver's at the present pose and at the meeting, the
    taker's at the meeting and at T_goal (7,).

    Raises:
        MotionError: NO_MOTION; an arm does not reach one of them.
    """
    start, found = state.poses[object], []
    for robot, contact, ends in (
        (meeting.giver, meeting.given, (start, meeting.T)),
        (meeting.taker, meeting.taken, (meeting.T, T_goal)),
    ):
        own = [contact_at(scene, state, robot, object, contact, T, rng).keyframes[0] for T in ends]
        found.append(RobotContact(robot, contact, 1, np.array(own)))
    return replace(found[0], clear=away_from_home(scene, state, meeting.giver)), found[1]
