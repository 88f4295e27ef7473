"""Which grasps serve at which placement, by the rigid hand alone: cheap bounds before any inverse kinematics."""

from dataclasses import dataclass, field, replace

import numpy as np

from hmap_core.contacts.candidates import Situation
from hmap_core.contacts.feasibility import CHUNK, reach_bounds, reachable, stretches
from hmap_core.contacts.grasp_torque import pad_balance, weight_torque_ratio
from hmap_core.contacts.hand import align_pads, drop_unfit_grasps, hand_of
from hmap_core.contacts.sampler import candidates
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner.contact_checker import cleared
from hmap_core.planner.sampled_contacts import PAD_BALANCE, TURNING_SHARE, sampled_surface
from hmap_core.planner.tools import farthest_points
from hmap_core.transforms import multiply, pose, rotation_matrix
from hmap_core.types import ContactKind, ContactPoint, Scene, SceneState, TaskMode

AT_ENDS = 160  # grasps kept that serve at the start, and at the goal
ANYWHERE = 80  # grasps kept beside these
SOLVED = (
    12  # grasps for which inverse kinematics is solved at both ends of an edge, with both signs of the closing axis
)
_HALF_TURN = pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


@dataclass(eq=False)
class GraspSet:
    """Grasps of one robot on the object.

    Attributes:
        robot: its name.
        contacts: the grasps, in the object's frame.
        manipulation: the robot about to handle the object; other robots are at home.
        turning: largest share of the friction against turning between the fingers that the weight may use.
    """

    robot: str
    contacts: list[ContactPoint]
    manipulation: Manipulation
    turning: float = TURNING_SHARE
    _masks: dict[bytes, np.ndarray] = field(default_factory=dict)

    def within_reach(self, T: np.ndarray) -> int:
        """For how many of the grasps the arm might be long enough with the object at T (7,)."""
        if not self.contacts:
            return 0
        return int((stretches(self.manipulation, self.contacts, T[None]) <= 1.0).sum())

    def serves(self, T: np.ndarray) -> np.ndarray:
        """Which grasps (K,) a hand alone could make with the object at T (7,), and lift it there."""
        key = T.tobytes()
        if key not in self._masks:
            self._masks[key] = free_at(self.manipulation, self.contacts, T, self.turning)
        return self._masks[key]

    def reaches(self, T: np.ndarray, rng: np.random.Generator) -> bool:
        """Whether the arm reaches one of the SOLVED grasps that serve at T (7,) for which it stretches least."""
        served = np.flatnonzero(self.serves(T))
        if not len(served):
            return False
        contacts = [self.contacts[k] for k in served]
        nearest = np.argsort(stretches(self.manipulation, contacts, T[None])[:, 0], kind="stable")[:SOLVED]
        return bool(reachable(self.manipulation, [contacts[k] for k in nearest], T, rng)[0].any())

    def hands(self, T_from: np.ndarray, T_to: np.ndarray, count: int, rng: np.random.Generator) -> list[ContactPoint]:
        """Up to ``count`` grasps that the arm reaches at both of two poses (7,) of the object."""
        both = np.flatnonzero(self.serves(T_from) & self.serves(T_to))
        chosen = [self.contacts[k] for k in rng.permutation(both)]
        chosen = [chosen[k] for k in farthest_points(chosen, SOLVED)]
        chosen = [hand for contact in chosen for hand in (contact, turned_over(contact))]
        found: list[ContactPoint] = []
        for first in range(0, len(chosen), CHUNK):
            contacts = chosen[first : first + CHUNK]
            for T in (T_from, T_to):
                if contacts:
                    ok, _ = reachable(self.manipulation, contacts, T, rng)
                    contacts = [contact for contact, good in zip(contacts, ok, strict=True) if good]
            found += contacts
            if len(found) >= count:
                break
        return found[:count]


def turned_over(contact: ContactPoint) -> ContactPoint:
    """The same grasp with the hand turned by 180 deg about its approach, so that the fingers change places."""
    return replace(contact, T_obj_ee=multiply(contact.T_obj_ee, _HALF_TURN))


def free_at(
    manipulation: Manipulation, contacts: list[ContactPoint], T: np.ndarray, turning: float = TURNING_SHARE
) -> np.ndarray:
    """Which contacts (K,) are free for the hand with the object at T (7,), and do not turn when they lift it.

    The weight may use the share ``turning`` of the friction against turning between the fingers.
    """
    if not contacts:
        return np.zeros(0, bool)
    scene, free = manipulation.scene, reach_bounds(manipulation, contacts, T[None]) >= 0
    gripper = scene.robots[manipulation.robot].model.require_gripper()
    share = weight_torque_ratio(scene.bodies[manipulation.handled], contacts, gripper, rotation_matrix(T)[2])
    return free & (share <= turning)


def grasp_sets(
    scene: Scene,
    state: SceneState,
    object: str,
    ends: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    turning: float = TURNING_SHARE,
) -> list[GraspSet]:
    """Grasps of all robots on an object: those that serve at its start or its goal, and some others.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        ends: its start and goal pose (7,), world frame.
        rng: the only source of randomness.
        turning: largest share of the friction against turning between the fingers that the weight may use; infinite
            where another hand carries a part of it.
    """
    surface = sampled_surface(scene, state, object, ends[0], rng)
    body, found = scene.bodies[object], []
    for name, robot in scene.robots.items():
        hand = hand_of(robot)
        if hand.gripper is None:
            continue
        situation = Situation(ends[0], None, robot.base_pose[:3])
        contacts: list[ContactPoint] = []
        for spanning in (False, True):
            for candidate_set in candidates(body, surface, hand, TaskMode.PHYSICAL, situation, rng, spanning):
                if candidate_set.kind == ContactKind.GRASP:
                    # both signs of the closing axis put the hand at the same place
                    contacts += candidate_set.contacts(np.arange(0, len(candidate_set), 2))
        even = pad_balance(body, contacts, hand.gripper)
        contacts = [contact for contact, share in zip(contacts, even, strict=True) if share >= PAD_BALANCE]
        contacts = align_pads(contacts, hand.gripper)
        manipulation, _ = cleared(scene, state, object, name)
        kept: list[ContactPoint] = []
        at_ends = [free_at(manipulation, contacts, T, turning) for T in ends]
        for wanted, most in ((at_ends[0] & at_ends[1], AT_ENDS), *((free, AT_ENDS) for free in at_ends)):
            kept += _thinned([contacts[k] for k in np.flatnonzero(wanted)], most)
        rest = ~(at_ends[0] | at_ends[1])
        kept += _thinned([contacts[k] for k in rng.permutation(np.flatnonzero(rest))[: 4 * ANYWHERE]], ANYWHERE)
        unique = list({contact.T_obj_ee.tobytes(): contact for contact in kept}.values())
        found.append(GraspSet(name, drop_unfit_grasps(body, unique, robot), manipulation, turning))
    return found


def _thinned(contacts: list[ContactPoint], most: int) -> list[ContactPoint]:
    if len(contacts) <= most:
        return contacts
    return [contacts[k] for k in farthest_points(contacts, most)]
