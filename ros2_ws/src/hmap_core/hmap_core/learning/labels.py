"""How far a contact gets: the stages of its check, the cheapest first, for many contacts of one query."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hmap_core.contacts.feasibility import Access, accesses, carried, reach_bounds
from hmap_core.planner.contact_checker import LocalContactChecker, cleared, least_reach
from hmap_core.planner.protocols import ContactQuery
from hmap_core.types import ContactPoint


class Stage(IntEnum):
    """The last stage that a contact reached. Later ones are evaluated for some contacts only."""

    HAND_COLLIDES = 0  # the rigid hand cannot come to the contact, or draw back
    HAND_SERVES_FEW = 1  # the rigid hand serves too few poses of the path, or the push slips
    HAND_SERVES = 2  # the rigid hand serves enough poses; the arm was not evaluated
    IK_INFEASIBLE = 3  # inverse kinematics finds no free configuration in contact
    CANNOT_DRAW_BACK = 4  # the arm cannot draw straight back to the pre-contact pose
    ARM_SERVES_FEW = 5  # the arm follows too few poses, or cannot leave
    FEASIBLE = 6  # the arm serves enough poses; no motion was planned
    NO_SEGMENT = 7  # the optimiser and the transit search find no motion
    NOT_VALID = 8  # the judge rejects the motion
    VALID = 9  # the judge accepts the motion; it was not executed
    EXECUTION_FAILED = 10  # the object does not arrive in the simulated world
    EXECUTED = 11  # the object arrives


REASONS = {
    Stage.HAND_COLLIDES: "the hand collides at the contact or while it draws back",
    Stage.HAND_SERVES_FEW: "hand or object collide on the path, or the push leaves its friction cone, too early",
    Stage.HAND_SERVES: "",
    Stage.IK_INFEASIBLE: "no collision-free configuration in contact",
    Stage.CANNOT_DRAW_BACK: "the arm cannot draw back to the pre-contact pose",
    Stage.ARM_SERVES_FEW: "the arm cannot follow the path far enough, or cannot leave there",
    Stage.FEASIBLE: "",
}
NOT_EVALUATED = -1


@dataclass(frozen=True)
class Labels:
    """The labels of K contacts.

    Attributes:
        stage: (K,) of :class:`Stage`.
        bound: (K,) index of the last pose that the rigid hand serves; -1: it cannot come.
        reach: (K,) index of the last pose that the arm serves, -1: it cannot come; NOT_EVALUATED where :attr:`checked`
            is False.
        checked: (K,) whether the arm was evaluated.
        keyframes: configurations of the feasible ones, by index.
    """

    stage: np.ndarray
    bound: np.ndarray
    reach: np.ndarray
    checked: np.ndarray
    keyframes: dict[int, np.ndarray]


def label_contacts(query: ContactQuery, contacts: Sequence[ContactPoint], most: int) -> Labels:
    """Label contacts of one query.

    Args:
        query: the robot, the object, and its poses (M, 7); its generator draws whose arm is evaluated.
        contacts: K contacts.
        most: number of contacts for which inverse kinematics is solved, drawn uniformly among those that the rigid
            hand serves; the arm of the others is not evaluated.
    """
    K, poses = len(contacts), query.object_poses
    manipulation, _ = cleared(query.scene, query.state, query.object, query.robot)
    checker = LocalContactChecker()
    release = checker.release(query.scene, query.state, query.object, poses)
    least = least_reach(poses)
    bound = reach_bounds(manipulation, contacts, poses) if K else np.zeros(0, int)
    stage = np.where(bound < 0, Stage.HAND_COLLIDES, np.where(bound < least, Stage.HAND_SERVES_FEW, Stage.HAND_SERVES))
    reach, checked = np.full(K, NOT_EVALUATED), stage != Stage.HAND_SERVES
    serving = np.flatnonzero(stage == Stage.HAND_SERVES)
    chosen = np.sort(query.rng.permutation(serving)[:most])
    keyframes: dict[int, np.ndarray] = {}
    if len(chosen):
        checked[chosen] = True
        access, q = accesses(manipulation, [contacts[k] for k in chosen], poses[0], query.rng)
        for k, came, configuration in zip(chosen.tolist(), access, q, strict=True):
            if came != Access.FREE:
                stage[k] = Stage.IK_INFEASIBLE if came == Access.NO_IK else Stage.CANNOT_DRAW_BACK
                continue
            ahead = slice(0, bound[k] + 1)
            path = carried(manipulation, contacts[k], configuration, poses[ahead], release[ahead])
            reach[k] = len(path) - 1
            stage[k] = Stage.FEASIBLE if len(path) > least else Stage.ARM_SERVES_FEW
            if stage[k] == Stage.FEASIBLE:
                keyframes[k] = path
    return Labels(stage.astype(np.int8), bound.astype(np.int32), reach.astype(np.int32), checked, keyframes)
