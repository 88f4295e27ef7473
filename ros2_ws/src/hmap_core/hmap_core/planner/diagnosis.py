"""Why no hand finds a contact on an object in some place, in words: for those who have to change the task."""

from collections import Counter
from itertools import islice

import numpy as np

from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.contacts.feasibility import stretches
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import free_opening, retreated
from hmap_core.komo.shapes import body_set
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.transforms import multiply
from hmap_core.types import ContactPoint, Robot, Scene, SceneState
from hmap_core.waypoints import stable_poses

BATCHES = 2  # of contacts that are looked at
TOO_FAR = "too far for the arm"
HAND_FREE = "free for the hand, but not for the arm on its way there and back"


def why_no_contact(scene: Scene, state: SceneState, object: str, T: np.ndarray, seed: int = 0) -> str:
    """What becomes of contacts by the hands of a scene on an object at a pose T (7,), which no robot can use there."""
    there = state.copy()
    there.poses[object] = T
    around = placed_bodies(scene, there, object)
    reasons = [_of_robot(scene, there, object, robot, around, np.random.default_rng(seed)) for robot in scene.robots]
    if not stable_poses(scene.bodies[object], np.array([T + LIFT, T]), around)[1]:
        reasons.insert(0, "it does not stand there by itself")
    return "; ".join(reasons)


def _of_robot(scene: Scene, state: SceneState, object: str, robot: str, around, rng: np.random.Generator) -> str:
    T = state.poses[object]
    batches = SampledContacts().propose(ContactQuery(scene, state, object, T[None], robot, rng))
    contacts = [contact for batch in islice(batches, BATCHES) for contact in batch.contacts]
    if not contacts:
        return f"'{robot}' finds nothing on it that it could grip or push"
    fates: Counter[str] = Counter()
    stretch = stretches(Manipulation(scene, state, robot, object), contacts, T[None])[:, 0]
    for contact, stretched in zip(contacts, stretch, strict=True):
        if stretched > 1.0:
            fates[TOO_FAR] += 1
        else:
            hit = _hit(scene.robots[robot], contact, T, around)
            fates[HAND_FREE if hit is None else f"with the hand in '{hit}'"] += 1
    return f"of {len(contacts)} contacts of '{robot}' " + ", ".join(
        f"{n} are {fate}" for fate, n in fates.most_common()
    )


def _hit(robot: Robot, contact: ContactPoint, T: np.ndarray, around) -> str | None:
    """The first body that a hand overlaps in a contact on an object at T (7,), or drawn back from it."""
    hand = from_hulls(load_arm(robot.model).hand(free_opening(robot, contact)))
    for T_obj_ee in (contact.T_obj_ee, retreated(contact)):
        T_ee = multiply(T, T_obj_ee)
        for body in around:
            if set_distance(hand, T_ee, body_set(body), body.pose, 0.0) < 0.0:
                return body.name
    return None
