"""Contacts for a given move: made where the object is, kept at the poses on its way, and released where it goes."""

import numpy as np

from hmap_core.contacts.feasibility import CHUNK, promising, reachable
from hmap_core.planner.contact_checker import LocalContactChecker, cleared, secure_grasps
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.types import ContactPoint, Scene, SceneState

COUNT = 8  # contacts that are found at once
TRIED = 48  # contacts of a batch for which inverse kinematics is solved


def contacts_of_move(
    scene: Scene, state: SceneState, robot: str, object: str, object_poses: np.ndarray, rng: np.random.Generator
) -> list[ContactPoint]:
    """Contacts that the arm reaches with the object at each of some poses; at most COUNT, in random order.

    They are the bound by poses of Logic-Geometric Programming (Toussaint and Lopes, Multi-bound tree search,
    2017). Whether the motion between the poses is possible is left to the path problem.

    Args:
        scene, state: the world, and where everything is.
        robot, object: names.
        object_poses: (M, 7) of the object: the present one, those on the way, and where it is released.
        rng: the only source of randomness.
    """
    manipulation, _ = cleared(scene, state, object, robot)
    release = LocalContactChecker().release(scene, state, object, object_poses)
    query = ContactQuery(scene, state, object, object_poses[:1], robot, rng)
    for batch in SampledContacts().propose(query):
        secure = secure_grasps(scene, object, robot, batch.contacts, object_poses[0])
        if not secure:
            continue
        order, _ = promising(manipulation, secure, object_poses, release, len(object_poses) - 1)
        chosen = [secure[k] for k in rng.permutation(order)[:TRIED]] if order else []
        found: list[ContactPoint] = []
        for first in range(0, len(chosen), CHUNK):
            reached = chosen[first : first + CHUNK]
            for T in object_poses:
                if reached:
                    ok, _ = reachable(manipulation, reached, T, rng)
                    reached = [contact for contact, good in zip(reached, ok, strict=True) if good]
            found += reached
            if len(found) >= COUNT:
                break
        if found:
            return found[:COUNT]
    return []
