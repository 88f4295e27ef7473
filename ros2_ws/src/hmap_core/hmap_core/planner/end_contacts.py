"""Contacts that can be made where an object stands and released where it has to go."""

import numpy as np

from hmap_core.contacts.feasibility import CHUNK, promising, reachable
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner.contact_checker import LocalContactChecker, cleared, secure_grasps
from hmap_core.planner.protocols import ContactProposer, ContactQuery
from hmap_core.planner.tools import farthest_points
from hmap_core.types import ContactPoint, Scene, SceneState

TRIED = 48  # contacts for which inverse kinematics is solved at the start and at the goal


class EndContacts:
    """Finds such contacts.

    Args:
        proposer: its contacts are checked.
    """

    def __init__(self, proposer: ContactProposer):
        self._proposer, self._checker = proposer, LocalContactChecker()

    def find(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        T_goal: np.ndarray,
        robot: str,
        count: int,
        seed: int,
        to_the_end: bool = True,
    ) -> list[ContactPoint]:
        """Find contacts that a robot can make at the start and release at the goal; none of them pushes.

        Whether the robot can get from one to the other is not checked. The contacts are far from each other.

        Args:
            scene, state: the world, and where everything is.
            object: name of the object.
            T_goal: (7,) goal pose of the object, world frame.
            robot: name of the robot.
            count: how many contacts are wanted at most.
            seed: the only source of randomness.
            to_the_end: whether it goes on after an empty batch.
        """
        rng = np.random.default_rng(seed)
        ends = np.array([state.poses[object], T_goal])
        manipulation, _ = cleared(scene, state, object, robot)
        release = self._checker.release(scene, state, object, ends)
        standing = ContactQuery(scene, state, object, ends[:1], robot, rng)  # an object that stands is not pushed
        for batch in self._proposer.propose(standing):
            if not (batch or to_the_end):
                break
            secure = secure_grasps(scene, object, robot, batch.contacts, ends[0])
            if not secure:
                continue
            order, _ = promising(manipulation, secure, ends, release, 1)
            chosen = [secure[k] for k in order]
            chosen = [chosen[k] for k in farthest_points(chosen, TRIED)]
            found: list[ContactPoint] = []
            for first in range(0, len(chosen), CHUNK):
                found += _reachable_everywhere(manipulation, chosen[first : first + CHUNK], ends, rng)
                if len(found) >= count:
                    break
            if found:
                return found[:count]
        return []


def _reachable_everywhere(
    manipulation: Manipulation, contacts: list[ContactPoint], object_poses: np.ndarray, rng: np.random.Generator
) -> list[ContactPoint]:
    """The contacts that the arm reaches with the object at each of object_poses (M, 7)."""
    for T in object_poses:
        if contacts:
            ok, _ = reachable(manipulation, contacts, T, rng)
            contacts = [contact for contact, good in zip(contacts, ok, strict=True) if good]
    return contacts
