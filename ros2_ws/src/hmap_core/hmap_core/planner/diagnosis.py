"""Why no hand finds a contact on an object in some place, in words: for those who have to change the task."""

from collections import Counter
from collections.abc import Sequence
from itertools import chain, islice

import numpy as np

from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.contacts.feasibility import reach_bounds, stretches
from hmap_core.contacts.grip_force import weight_ratio
from hmap_core.contacts.grip_width import grip_problem
from hmap_core.contacts.push_path import final_pushes, first_pushes
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import free_opening, retreated
from hmap_core.komo.shapes import body_set
from hmap_core.planner.contact_checker import cleared
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.sampled_presses import SampledPresses
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.transforms import multiply, rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint, Robot, Scene, SceneState
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.checker import PENETRATION_ALLOWED

PUSHED_STEPS = 3  # poses of a push, 1 cm apart, for which an object needs room before it, and a finger behind it
BATCHES = 2  # of contacts whose fate is told
TOO_FAR = "too far for the arm"
SLIPS = "free for the hand, but the friction of its pads does not carry the weight"
HAND_FREE = "free for the hand, but not for the arm on its way there and back"


def why_no_contact(scene: Scene, state: SceneState, object: str, T: np.ndarray, seed: int = 0) -> str:
    """What becomes of contacts by the hands of a scene on an object at a pose T (7,), which no robot can use there."""
    there = state.copy()
    there.poses[object] = T
    around = placed_bodies(scene, there, object)
    reasons = [_of_robot(scene, there, object, robot, around, seed) for robot in scene.robots]
    if not stable_poses(scene.bodies[object], np.array([T + LIFT, T]), around)[1]:
        reasons.insert(0, "it does not stand there by itself")
    return "; ".join(reasons)


def why_not_moved(scene: Scene, state: SceneState, object: str) -> str:
    """Why no hand moves an object from where it is: what becomes of grips, and what is around it for a push."""
    grips = grip_problem(scene, object, scene.robots) or why_no_contact(scene, state, object, state.poses[object])
    enclosing = _enclosing(scene, state, object)
    if not enclosing:
        return grips
    walls = " and ".join(f"'{name}'" for name in enclosing)
    return f"{grips}; it cannot be pushed away either, for it needs room before it and behind it: {walls}"


def hand_fits(scene: Scene, state: SceneState, object: str, seed: int = 0) -> bool:
    """Whether a hand alone, without the arm, can grip an object where it is, or push or drag it to where it has room.

    Some thousand contacts are looked at before the answer is no.
    """
    pushed = first_pushes(scene.bodies[object], state.poses[object], PUSHED_STEPS)
    ways = [way for way in pushed if not overlapped(scene, state, object, way[-1])]
    rng = np.random.default_rng(seed)
    # grasps are among the contacts for each push
    return any(_serves(scene, state, object, way, 0, rng) for way in ways or [state.poses[object][None]])


def hand_fits_at_goal(scene: Scene, state: SceneState, object: str, T: np.ndarray, seed: int = 0) -> bool:
    """Whether a hand alone can release an object at a pose T (7,), or push or drag it there over the last centimetres.

    As :func:`hand_fits`.
    """
    pushed = final_pushes(scene.bodies[object], T, PUSHED_STEPS)
    ways = [way for way in pushed if not overlapped(scene, state, object, way[0])]
    rng = np.random.default_rng(seed)
    there = state.copy()
    for way in [T[None], *ways]:  # grasps that come from above are among the contacts for the pose alone
        there.poses[object] = way[0]
        if _serves(scene, there, object, way, len(way) - 1, rng):
            return True
    return False


def _serves(scene: Scene, state: SceneState, object: str, poses: np.ndarray, least: int, rng) -> bool:
    """Whether a hand alone can make a contact that serves as far as a pose, by its number, of the object's (M, 7)."""
    for robot in scene.robots:
        manipulation, _ = cleared(scene, state, object, robot)
        query = ContactQuery(scene, state, object, poses, robot, rng)
        for batch in chain(SampledContacts().propose(query), SampledPresses().propose(query)):
            if len(batch.contacts) and (reach_bounds(manipulation, batch.contacts, poses) >= least).any():
                return True
    return False


def overlapped(scene: Scene, state: SceneState, object: str, T: np.ndarray) -> set[str]:
    """Names of the bodies that an object would penetrate at a pose T (7,)."""
    own = body_set(scene.bodies[object])
    return {
        other.name
        for other in placed_bodies(scene, state, object)
        if set_distance(own, T, body_set(other), other.pose) < -PENETRATION_ALLOWED
    }


def _enclosing(scene: Scene, state: SceneState, object: str) -> list[str]:
    """Bodies that keep an object from being pushed on any of its sides: in its way, or where the hand would be."""
    T, names = state.poses[object], set()
    for way in first_pushes(scene.bodies[object], T, PUSHED_STEPS):
        behind = np.concatenate([2.0 * T[:3] - way[-1, :3], T[3:]])
        hits = overlapped(scene, state, object, way[-1]) | overlapped(scene, state, object, behind)
        if not hits:
            return []
        names |= hits
    return sorted(names)


def _of_robot(scene: Scene, state: SceneState, object: str, robot: str, around: Sequence[Body], seed: int) -> str:
    fates = _fates(scene, state, object, robot, around, seed)
    if not fates:
        problem = grip_problem(scene, object, [robot])
        return f"'{robot}' finds nothing on it that it could grip or push{f': {problem}' if problem else ''}"
    return f"of {fates.total()} contacts of '{robot}' " + ", ".join(
        f"{n} are {fate}" for fate, n in fates.most_common()
    )


def _fates(
    scene: Scene,
    state: SceneState,
    object: str,
    robot: str,
    around: Sequence[Body],
    seed: int,
    poses: np.ndarray | None = None,
) -> Counter[str]:
    """How many contacts of a robot on an object have which fate; pushes along poses (M, 7) are among them."""
    T = state.poses[object]
    poses = T[None] if poses is None else poses
    query = ContactQuery(scene, state, object, poses, robot, np.random.default_rng(seed))
    contacts = [contact for batch in islice(SampledContacts().propose(query), BATCHES) for contact in batch.contacts]
    fates: Counter[str] = Counter()
    if not contacts:
        return fates
    stretch = stretches(Manipulation(scene, state, robot, object), contacts, T[None])[:, 0]
    for contact, stretched in zip(contacts, stretch, strict=True):
        if stretched > 1.0:
            fates[TOO_FAR] += 1
            continue
        placed = scene.robots[robot]
        hit = _hit(placed, contact, T, around)
        slips = not hit and _slips(scene.bodies[object], contact, placed, T)
        fates[SLIPS if slips else f"with the hand in {' and '.join(map(repr, hit))}" if hit else HAND_FREE] += 1
    return fates


def _slips(body: Body, contact: ContactPoint, robot: Robot, T: np.ndarray) -> bool:
    """Whether the pads' friction does not carry the weight in a grasp of a body at T (7,)."""
    if contact.kind != ContactKind.GRASP:
        return False
    return bool(weight_ratio(body, [contact], robot.model, rotation_matrix(T)[2])[0] > 1.0)


def _hit(robot: Robot, contact: ContactPoint, T: np.ndarray, around: Sequence[Body]) -> list[str]:
    """The bodies that a hand overlaps in a contact on an object at T (7,), or else drawn back from it."""
    hand = from_hulls(load_arm(robot.model).hand(free_opening(robot, contact)))
    for T_obj_ee in (contact.T_obj_ee, retreated(contact)):
        T_ee = multiply(T, T_obj_ee)
        hit = [body.name for body in around if set_distance(hand, T_ee, body_set(body), body.pose, 0.0) < 0.0]
        if hit:
            return hit
    return []
