"""The feasibility half of Algorithm 3: which contacts a robot can reach, and how far they can carry the object.

Eq. (3) of the paper as a batch, cheapest question first. The hand, and the object in it, are rigid: whether they are
free at the contact, while drawing back, and along the object's path does not depend on the arm, so it is answered for
all candidates without any inverse kinematics. What is left is tried in the order of how far it could serve at best:
the contact and the pre-contact pose have to be reachable without collision, then the robot is led along the object's
path in small steps, which says how far the contact really serves. So waypoints are cut where contacts end, not at
fixed distances.
"""

import math
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from hmap_core.contacts.hand import hand_of
from hmap_core.contacts.hand_reach import hand_reach
from hmap_core.contacts.press import press_reach
from hmap_core.contacts.push import push_reach
from hmap_core.deadline import check_time
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik, solve_ik_batch
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import APPROACH_STEPS, Phase, bit, retreat_distance
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import apply, inverse, multiply, multiply_all, rotation_matrices, rotation_matrix
from hmap_core.types import ContactKind, ContactPoint, TaskMode
from hmap_core.waypoints.stable_poses import stable_poses

RESTARTS = 2  # random configurations tried after the home configuration
MAX_JUMP = 0.2  # rad a joint may turn between two neighbouring poses: about a centimetre of the hand
COARSE_POSES = 24  # places of the object's path at which the hand alone is looked at
CHUNK = 4  # candidates solved together
MAX_SOLVED = 64  # candidates solved at most
PER_ORIENTATION = 4  # of these, of each orientation of an attached tool, from where the robot is
SWING = 1.5  # rad that a joint turns to a contact, from where on a configuration nearer to the robot's is looked for
LESS_SWING = 0.5  # rad by which it has to be nearer
STRETCHED = 0.85  # of an arm's span, from where on it seldom follows
OPENING_RESOLUTION = 1e-4  # m: contacts whose fingers open alike to this are checked together


@dataclass(frozen=True)
class Feasible:
    """A candidate that works: its index, and the configurations (reach + 1, n) in contact at the object poses 0 ..
    reach."""

    index: int
    keyframes: np.ndarray


def ik_problem(manipulation: Manipulation, collisions, phase: Phase) -> KomoProblem:
    """The one-step problem of bringing the end-effector to a pose in a phase."""
    return manipulation.ik_problem(collisions, phase)


def feasible_contacts(
    manipulation: Manipulation,
    contacts: Sequence[ContactPoint],
    object_poses: np.ndarray,
    release: np.ndarray,
    rng: np.random.Generator,
    least: int,
    enough: int,
    deadline: float = math.inf,
) -> list[Feasible]:
    """The contacts that can be taken at object_poses[0] and carry the object to at least pose ``least`` of (M, 7).

    ``release`` (M,) says at which poses the object may be let go. Stops when ``enough`` were found and none that is
    left could serve farther than the best of them, or after the ``deadline`` (``time.monotonic()``). With a tool
    attached, configurations near the present one come first: between two contacts of a tool, the arm should not swing.
    """
    order, bound = promising(manipulation, contacts, object_poses, release, least)
    found: list[Feasible] = []

    def best() -> int:
        return max((len(f.keyframes) - 1 for f in found), default=-1)

    def try_all(some: Sequence[int], near: bool) -> None:
        for first in range(0, len(some), CHUNK):
            chunk = some[first : first + CHUNK]
            if len(found) >= enough and max(bound[chunk]) <= best():
                return
            ok, q = reachable(manipulation, [contacts[k] for k in chunk], object_poses[0], rng, near=near)
            for k, configuration in zip(np.array(chunk)[ok], q[ok], strict=True):
                if (len(found) >= enough and bound[k] <= best()) or time.monotonic() > deadline:
                    return
                ahead = slice(0, bound[k] + 1)
                keyframes = carried(manipulation, contacts[k], configuration, object_poses[ahead], release[ahead])
                if len(keyframes) > least:
                    found.append(Feasible(int(k), keyframes))

    if order and manipulation.scene.robots[manipulation.robot].model.attached is not None:
        try_all(_nearest(manipulation, contacts, order, object_poses[0]), near=True)
        if best() >= bound[order[0]]:
            return found
    try_all(order, near=False)
    return [_nearer(manipulation, contacts[f.index], f, object_poses, release, rng) for f in found]


def _nearer(
    manipulation: Manipulation,
    contact: ContactPoint,
    found: Feasible,
    object_poses: np.ndarray,
    release: np.ndarray,
    rng: np.random.Generator,
) -> Feasible:
    """The same contact with configurations nearer to where the robot is, if the arm would swing far to those found."""
    start = manipulation.state.q[manipulation.robot]
    swing = float(np.abs(found.keyframes[0] - start).max())
    if swing <= SWING:
        return found
    ok, q = reachable(manipulation, [contact], object_poses[0], rng, near=True)
    if not ok[0] or np.abs(q[0] - start).max() > swing - LESS_SWING:
        return found
    ahead = slice(0, len(found.keyframes))
    keyframes = carried(manipulation, contact, q[0], object_poses[ahead], release[ahead])
    return Feasible(found.index, keyframes) if len(keyframes) == len(found.keyframes) else found


def promising(
    manipulation: Manipulation,
    contacts: Sequence[ContactPoint],
    object_poses: np.ndarray,
    release: np.ndarray,
    least: int,
) -> tuple[list[int], np.ndarray]:
    """The contacts that pass the checks of the rigid hand: their indices, and how far each of all (K,) could serve.

    At most MAX_SOLVED, the farthest-reaching first, of these the ones for which the arm need not stretch. None of them
    ends before pose ``least`` of object_poses (M, 7), nor where ``release`` (M,) says that it may not be let go.
    """
    places = coarse(len(object_poses))
    stretch = stretches(manipulation, contacts, object_poses[places])
    bound = _bounds(manipulation, contacts, object_poses, stretch)
    stretch = np.where(places <= bound[:, None], stretch, 0.0)
    allowed = np.flatnonzero(release)
    # the last pose up to the bound at which the object stands by itself
    last = np.append(allowed, -1)[np.searchsorted(allowed, bound, side="right") - 1]
    bound = np.where(bound >= 0, np.where(last <= bound, last, -1), -1)
    order = np.lexsort((np.arange(len(contacts)), stretch.max(axis=1) > STRETCHED, -bound))
    return [int(k) for k in order if bound[k] >= least][:MAX_SOLVED], bound


def _nearest(
    manipulation: Manipulation, contacts: Sequence[ContactPoint], order: Sequence[int], T_world_obj: np.ndarray
) -> list[int]:
    """Of contacts of an attached tool in an order, some of each of its orientations, the least turned ones first."""
    robot = manipulation.scene.robots[manipulation.robot]
    now = multiply(robot.base_pose, manipulation.arm.end_effector(manipulation.state.q[manipulation.robot]))
    frames = rotation_matrices(np.array([contacts[k].T_obj_ee for k in order]))
    turned = (rotation_matrix(now).T @ rotation_matrix(T_world_obj) @ frames).reshape(-1, 9)
    counts: Counter[tuple[float, ...]] = Counter()
    kept = []
    for place, orientation in enumerate(np.round(turned, 1).tolist()):
        counts[tuple(orientation)] += 1
        if counts[tuple(orientation)] <= PER_ORIENTATION:
            kept.append(place)
    angle = np.arccos(np.clip(0.5 * (turned[kept][:, [0, 4, 8]].sum(axis=1) - 1.0), -1.0, 1.0))
    return [int(order[kept[k]]) for k in np.argsort(angle, kind="stable")]


def reach_bounds(manipulation: Manipulation, contacts: Sequence[ContactPoint], object_poses: np.ndarray) -> np.ndarray:
    """Farthest pose (K,) to which hand and object alone could go and the hand then leave; -1: it cannot even come.

    Nor does it go where the arm is too short to follow. A push or press ends before it would slip. The path is looked
    at in at most COARSE_POSES places, so this is a bound and not the reach itself.
    """
    stretch = stretches(manipulation, contacts, object_poses[coarse(len(object_poses))])
    return _bounds(manipulation, contacts, object_poses, stretch)


def _bounds(
    manipulation: Manipulation, contacts: Sequence[ContactPoint], object_poses: np.ndarray, stretch: np.ndarray
) -> np.ndarray:
    """:func:`reach_bounds`, with how far (K, P) the arm stretches at each of the coarse places."""
    M = len(object_poses)
    places = coarse(M)
    R_obj = rotation_matrices(object_poses[places])
    p_obj = np.ascontiguousarray(object_poses[places, :3])
    T_ee_tip = inverse(manipulation.T_tip_ee)
    # the first place that is blocked or out of reach is not reached, but all before it may be
    limit = np.append(places[1:] - 1, M - 1)
    near = stretch <= 1.0
    within = np.where(near.all(axis=1), len(places), near.argmin(axis=1))
    bound = np.full(len(contacts), -1)
    possible = np.flatnonzero(within > 0)
    for own in alike([contacts[k] for k in possible.tolist()]):
        check_time()
        members = possible[own]
        first = contacts[int(members[0])]
        at_start = manipulation.coming_collisions(first, object_poses[0]).arrays()
        on_path = manipulation.surroundings(first).arrays()
        frames = np.array([contacts[k].T_obj_ee for k in members])
        back = drawn_back([contacts[k] for k in members])
        place = hand_reach(
            R_obj, p_obj, rotation_matrices(frames), np.ascontiguousarray(frames[:, :3]), back,
            rotation_matrix(T_ee_tip), T_ee_tip[:3], manipulation.tip, bit(Phase.APPROACH), bit(Phase.TRANSIT),
            bit(Phase.HOLD), at_start, on_path,
        )  # fmt: skip
        bound[members] = np.where(place >= 0, limit[np.minimum(place, within[members] - 1)], -1)
    scene = manipulation.scene
    body = scene.bodies[manipulation.handled]
    slides = np.array([contact.kind == ContactKind.PUSH for contact in contacts])
    if (bound[slides] > 0).any():
        hand = hand_of(scene.robots[manipulation.robot])
        bound = np.minimum(bound, push_reach(body, hand, contacts, object_poses))
        if scene.mode == TaskMode.PHYSICAL and (bound[slides] > 0).any():
            bound[slides] = np.minimum(bound[slides], _on_support(manipulation, object_poses))
    if any(contact.kind == ContactKind.PRESS for contact in contacts):
        poses = manipulation.state.poses
        around = [replace(other, pose=poses[name]) for name, other in scene.bodies.items() if name != body.name]
        model = scene.robots[manipulation.robot].model
        bound = np.minimum(bound, press_reach(body, model, contacts, object_poses, around))
    return bound


def _on_support(manipulation: Manipulation, object_poses: np.ndarray) -> int:
    """Index of the last of the poses (M, 7) up to which the object stands stably on what is around; at least 0."""
    scene, poses, name = manipulation.scene, manipulation.state.poses, manipulation.handled

    def last() -> int:
        around = [replace(other, pose=poses[other.name]) for other in scene.bodies.values() if other.name != name]
        stands = stable_poses(scene.bodies[name], object_poses, around)
        return max(int(np.argmin(np.append(stands, False))) - 1, 0)

    return manipulation.known(("on support", name, object_poses.tobytes()), last)


def coarse(M: int) -> np.ndarray:
    """Indices of at most COARSE_POSES of M poses, the first and the last among them."""
    if M <= COARSE_POSES:
        return np.arange(M)
    return np.unique(np.round(np.linspace(0, M - 1, min(M, COARSE_POSES))).astype(int))


def stretches(manipulation: Manipulation, contacts: Sequence[ContactPoint], object_poses: np.ndarray) -> np.ndarray:
    """How far (K, P) the last joint is from the first one in contacts on an object at poses (P, 7), by what it can be.

    Beyond 1 the arm is too short.
    """
    arm = manipulation.arm
    centre = apply(manipulation.scene.robots[manipulation.robot].base_pose, arm.p_joint[0])
    frames = np.array([contact.T_obj_ee for contact in contacts])
    tips = frames[:, :3] + rotation_matrices(frames) @ inverse(manipulation.T_tip_ee)[:3]  # object frame
    away = tips @ rotation_matrices(object_poses).swapaxes(1, 2) + (object_poses[:, None, :3] - centre)  # (P, K, 3)
    return np.sqrt(np.einsum("pki,pki->kp", away, away)) / arm.span


def drawn_back(contacts: Sequence[ContactPoint]) -> np.ndarray:
    """Where (K, 3) the end-effectors of contacts are once they have drawn back, object frame."""
    frames = np.array([c.T_obj_ee for c in contacts])
    ways = np.array([retreat_distance(c) for c in contacts])[:, None] * np.array([c.approach for c in contacts])
    return frames[:, :3] - (rotation_matrices(frames) @ ways[:, :, None])[:, :, 0]


def alike(contacts: Sequence[ContactPoint]) -> list[list[int]]:
    """Indices of contacts whose fingers are open alike, group by group: they share a collision model."""
    groups: dict[tuple[ContactKind, int], list[int]] = defaultdict(list)
    for k, contact in enumerate(contacts):
        groups[contact.kind, round(contact.opening / OPENING_RESOLUTION)].append(k)
    return list(groups.values())


class Access(IntEnum):
    """How far a robot comes to a contact."""

    NO_IK = 0  # inverse kinematics finds no free configuration in contact
    NO_WAY_BACK = 1  # it cannot draw back to the pre-contact pose
    FREE = 2  # it can come and go


def reachable(
    manipulation: Manipulation,
    contacts: Sequence[ContactPoint],
    T_world_obj: np.ndarray,
    rng: np.random.Generator,
    from_home: bool = True,
    near: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Which contacts can be come to with the object at T_world_obj (7,): (ok (K,), configurations in contact (K, n)).

    Inverse kinematics starts from home, unless ``from_home`` is False, and from random configurations; if ``near``,
    only from where the robot is.
    """
    access, q = accesses(manipulation, contacts, T_world_obj, rng, from_home, near)
    return access == Access.FREE, q


def accesses(
    manipulation: Manipulation,
    contacts: Sequence[ContactPoint],
    T_world_obj: np.ndarray,
    rng: np.random.Generator,
    from_home: bool = True,
    near: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """As :func:`reachable`, with how far the robot comes to each contact: (:class:`Access` (K,), configurations)."""
    n = manipulation.model.n
    access, q = np.full(len(contacts), int(Access.NO_IK)), np.zeros((len(contacts), n))
    chain = manipulation.model.chain
    home = manipulation.scene.robots[manipulation.robot].model.home
    if near:
        starts = [manipulation.state.q[manipulation.robot]]
    else:
        starts = [home] * from_home + [*rng.uniform(chain.lower, chain.upper, (RESTARTS, n))]
    for members in alike(contacts):
        check_time()
        index = np.array(members)
        collisions = manipulation.coming_collisions(contacts[members[0]], T_world_obj)
        problem = ik_problem(manipulation, collisions, Phase.APPROACH)
        goal = np.array([multiply(T_world_obj, contacts[k].T_obj_ee) for k in members])
        goal = pose_params_all(manipulation.T_tip_ee, goal)
        todo = np.arange(len(members))
        for start in starts:
            initial = np.tile(start, (len(todo), 1))
            found, feasible = solve_ik_batch(problem, goal[todo], initial, initial)
            for k, configuration in zip(todo[feasible], found[feasible], strict=True):
                free = len(draw_back(manipulation, problem, contacts[members[k]], T_world_obj, configuration)) > 0
                access[index[k]] = Access.FREE if free else Access.NO_WAY_BACK
                if free:
                    q[index[k]] = configuration
            todo = np.array([k for k in todo if access[index[k]] != Access.FREE], int)
            if not len(todo):
                break
    return access, q


def carried(
    manipulation: Manipulation, contact: ContactPoint, q: np.ndarray, object_poses: np.ndarray, release: np.ndarray
) -> np.ndarray:
    """Configurations (m, n) of the robot that carries the object along object_poses (M, 7) as far as it can, and
    then leave.

    Args:
        q: (n,) configuration in contact at the first pose.
        release: (M,) poses at which the object may be let go.
    """
    carrying = ik_problem(manipulation, manipulation.carrying_collisions(contact), Phase.HOLD)
    targets = pose_params_all(manipulation.T_tip_ee, multiply_all(object_poses, contact.T_obj_ee))
    path = follow_ik(carrying, targets, q, MAX_JUMP)
    if len(object_poses) == 1:
        return path
    places = np.flatnonzero(release[: len(path)])[::-1]
    at, step = 0, 1
    while at < len(places) and places[at] > 0:
        reach = places[at]
        T_end = object_poses[reach]
        leaving = ik_problem(manipulation, manipulation.leaving_collisions(contact, T_end), Phase.RETREAT)
        if len(draw_back(manipulation, leaving, contact, T_end, path[reach])):
            return path[: reach + 1]
        at, step = at + step, step * 2
    return path[:0]


def draw_back(
    manipulation: Manipulation, problem: KomoProblem, contact: ContactPoint, T_world_obj: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """As :func:`drawn_back_path`, to the pre-contact configuration; none where it cannot go there."""
    path = drawn_back_path(manipulation, problem, contact, T_world_obj, q)
    return path if len(path) == APPROACH_STEPS else path[:0]


def drawn_back_path(
    manipulation: Manipulation, problem: KomoProblem, contact: ContactPoint, T_world_obj: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """Configurations (m, n) straight back from the contact, as far as there is room; all APPROACH_STEPS lead to
    pre-contact.

    Args:
        problem: an :func:`ik_problem` of the phase in which the hand comes or goes.
        q: (n,) configuration in contact.
    """
    touching = multiply(T_world_obj, contact.T_obj_ee)
    fractions = np.arange(1, APPROACH_STEPS + 1)[:, None] / APPROACH_STEPS
    poses = np.tile(touching, (APPROACH_STEPS, 1))
    poses[:, :3] -= fractions * retreat_distance(contact) * (rotation_matrix(touching) @ contact.approach)
    return follow_ik(problem, pose_params_all(manipulation.T_tip_ee, poses), q, MAX_JUMP)
