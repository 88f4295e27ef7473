"""End-effector frames of contacts for arms that do not reach every orientation.

A contact constrains a part of the end-effector frame only: a touch the point, a push the point and the hand's axis
along the face, a grasp the point between the pads and the closing axis. What is left is free: three, one and one
rotation. The samplers draw it at random, and few of these frames are within the mobility of an arm with fewer than six
joints. Here inverse kinematics solves the free rotation together with the joints, near the sampled one. The result is a
full frame again, so that all later steps are the same for every arm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.contacts.candidates import FEATURE, Hand, clear_of_palm, frames, on_surface, tangents
from hmap_core.contacts.feasibility import RESTARTS, drawn_back
from hmap_core.contacts.grasp import depth_below
from hmap_core.contacts.grasp_axis import turned_grasps
from hmap_core.contacts.sampler import in_regions
from hmap_core.contacts.solids import Solids, solids
from hmap_core.contacts.touch import turned_frames
from hmap_core.komo.features import axis_alignment, pose_params_all, relative_pose, relative_position
from hmap_core.komo.ik import solve_ik_batch
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.segment import Phase
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import (
    IDENTITY,
    apply,
    inverse,
    multiply_all,
    rotation_matrices,
    rotation_matrix,
)
from hmap_core.types import Body, ContactKind, ContactPoint

TURNS = 4  # the hand's foremost point depends on its orientation, so both are found in turns
ON_POINT = 3e-5  # m that the hand may be off the surface, less than the gap that contacts leave
BESIDE_POINT = 2e-3  # m that it may be off the contact point along the surface
NEARNESS = 100.0  # weight of the sampled orientation, 1 / rad^2; inverse kinematics weighs the joints by 0.02
FIRST_PLACE = 2  # pose of the object's path that a contact has to serve to at least, as far as there is one
PLACES = 5  # poses of the path, from that one on, at which it is looked whether the frame is reached
SAME_AXIS = 0.01  # rad that a closing axis may be off the sampled one without another grasp being made of it
UPRIGHT = 1e-3  # sine of a face's angle to the vertical up to which a hand may touch it at any height
LEVEL = 0.5  # sine of the angle to the vertical from which on a closing axis can be made horizontal
SAME_FRAME = 1e-3  # m and in entries of the rotation matrix: frames that differ by less are one


@dataclass(frozen=True)
class _Constraint:
    """What K contacts of one kind constrain, object frame.

    Attributes:
        contacts: the contacts.
        own: the object's shapes.
        hand: the fingers.
        axis: (K, 3) of the hand, end-effector frame, and
        direction: (K, 3) along which it lies; None if every rotation is allowed.
        up: (3,) vertical direction.
        slides: whether any height of the hand's foremost part may touch, and not only its lower end.
    """

    contacts: Sequence[ContactPoint]
    own: Solids
    hand: Hand
    axis: np.ndarray | None
    direction: np.ndarray | None
    up: np.ndarray
    slides: bool = False

    def __getitem__(self, chosen: np.ndarray) -> "_Constraint":
        contacts = [self.contacts[k] for k in chosen.tolist()]
        if self.axis is None or self.direction is None:
            return replace(self, contacts=contacts)
        return replace(self, contacts=contacts, axis=self.axis[chosen], direction=self.direction[chosen])

    @cached_property
    def surface(self) -> np.ndarray:
        """The contact points (K, 3)."""
        return np.array([contact.point for contact in self.contacts])

    @cached_property
    def normals(self) -> np.ndarray:
        """The normals (K, 3) there."""
        return np.array([contact.normal for contact in self.contacts])

    def points(self, T_obj_ee: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of the hand, and where they have to be, for a hand near frames T_obj_ee (K, 7).

        Returns:
            Points (K, 3) in the end-effector frame, points (K, 3) in the object frame, and (K,) whether the hand fits.
        """
        R = rotation_matrices(T_obj_ee)
        if self.contacts[0].kind == ContactKind.GRASP:
            width = np.array([contact.opening for contact in self.contacts])
            middle = self.surface - 0.5 * width[:, None] * self.normals
            above = depth_below(middle, np.ascontiguousarray(-R[:, :, 2]), *self.own.arrays)
            shallower, fits = clear_of_palm(above, self.hand)
            return np.c_[np.zeros((len(R), 2)), shallower], middle, fits
        origin, feature = on_surface(R, self.surface, self.normals, self.hand.tip, self.hand.tip_radius, end=-self.up)
        points = feature @ self.hand.tip / feature.sum(axis=1)[:, None]
        targets = origin + np.einsum("kij,kj->ki", R, points)
        if self.slides:
            higher = np.clip((origin - T_obj_ee[:, :3]) @ self.up, 0.0, self._room_above(R, origin, points))
            points = points + higher[:, None] * np.einsum("kij,i->kj", R, self.up)
        return points, targets, np.ones(len(R), bool)

    def _room_above(self, R: np.ndarray, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        """How far (K,) the foremost part of the hand at orientations R and origins extends above its points, m."""
        corners = np.einsum("kij,vj->kvi", R, self.hand.tip)
        off = np.einsum("kvi,ki->kv", corners + (origin - self.surface)[:, None], self.normals) - self.hand.tip_radius
        foremost = off <= off.min(axis=1)[:, None] + FEATURE
        highest = np.where(foremost, corners @ self.up, -np.inf).max(axis=1)
        upright = np.abs(self.normals @ self.up) <= UPRIGHT
        return np.where(upright, highest - np.einsum("kij,kj->ki", R, points) @ self.up, 0.0)

    def fulfilled(self, T_obj_ee: np.ndarray) -> np.ndarray:
        """Whether (K,) end-effector frames (K, 7) make the contacts."""
        points, targets, fits = self.points(T_obj_ee)
        off = T_obj_ee[:, :3] + np.einsum("kij,kj->ki", rotation_matrices(T_obj_ee), points) - targets
        across = np.einsum("ki,ki->k", off, self.normals)
        beside = np.linalg.norm(off - across[:, None] * self.normals, axis=1)
        return fits & (np.abs(across) <= ON_POINT) & (beside <= BESIDE_POINT)


def reached_frames(
    manipulation: Manipulation,
    body: Body,
    hand: Hand,
    contacts: Sequence[ContactPoint],
    object_poses: np.ndarray,
    rng: np.random.Generator,
) -> list[ContactPoint]:
    """Contacts with the free rotation chosen so that the arm reaches the end-effector frame.

    Nothing that could be in the way is looked at.

    Args:
        manipulation: the robot and the object.
        body: the object.
        hand: the robot's fingers, or the attached body.
        contacts: sampled contacts.
        object_poses: (M, 7) T_world_obj; the contact is made at the first one.
        rng: the only source of randomness.

    Returns:
        The contacts that the arm reaches, drawn back as well, without repetitions. The ones that it can follow
        farthest along the path come first; otherwise they keep their order.
    """
    own, T_world_obj = solids([(shape, IDENTITY) for shape in body.shapes]), object_poses[0]
    up = rotation_matrix(T_world_obj)[2]
    placed: dict[int, tuple[ContactPoint, np.ndarray]] = {}
    for kind in dict.fromkeys(contact.kind for contact in contacts):
        index = [k for k, contact in enumerate(contacts) if contact.kind == kind]
        chosen = [contacts[k] for k in index]
        solver = _FrameSolver(manipulation, T_world_obj, rotates_freely=kind == ContactKind.TOUCH)
        if kind == ContactKind.GRASP:
            chosen = _axes_within_reach(solver, chosen, body, own, hand, up)
        R, constraint = _constraint(chosen, own, hand, up, rng)
        for k, contact, q in _placed(solver, constraint, R, rng):
            placed[index[k]] = contact, q
    kept = _distinct([placed[k] for k in sorted(placed)])
    return _followed(manipulation, kept, object_poses)


def _constraint(
    contacts: list[ContactPoint], own: Solids, hand: Hand, up: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, _Constraint]:
    """Orientations (K, 3, 3) near which contacts of one kind are sought, and what they constrain.

    Every other touch is sought with the hand upright: a motion on a support turns the object about the vertical, and
    an arm with five joints follows it only with such a hand.
    """
    R = rotation_matrices(np.array([contact.T_obj_ee for contact in contacts]))
    kind = contacts[0].kind
    if kind == ContactKind.TOUCH:
        down = np.tile(-up, (len(R[::2]), 1))
        R[::2] = turned_frames(down, tangents(down, np.eye(3)[0])[0], rng.uniform(-np.pi, np.pi, len(down)))
        return R, _Constraint(contacts, own, hand, None, None, up)
    if kind == ContactKind.GRASP:
        along = R[:, :, 1]
    else:
        along = np.cross(up, [contact.normal for contact in contacts])
        along /= np.linalg.norm(along, axis=1)[:, None]
    return R, _Constraint(contacts, own, hand, np.einsum("kij,ki->kj", R, along), along, up)


class _FrameSolver:
    """Inverse kinematics of what contacts of one kind constrain, with the object at a pose."""

    def __init__(self, manipulation: Manipulation, T_world_obj: np.ndarray, rotates_freely: bool):
        self.home = manipulation.scene.robots[manipulation.robot].model.home
        self._chain = manipulation.model.chain
        self._manipulation, self._T_world_obj, self._T_obj_world = manipulation, T_world_obj, inverse(T_world_obj)
        tip = manipulation.tip
        near = relative_pose(tip, IDENTITY, IDENTITY)
        constraints = [relative_position(tip)]
        if not rotates_freely:
            constraints.append(axis_alignment(tip, np.zeros(3), np.zeros(3)))
        self._near, self._exact = (KomoProblem(self._chain, (1,), CollisionModel(), IK_OPTIONS) for _ in range(2))
        for feature in constraints:
            self._exact.add(Objective(feature, ObjectiveType.EQ, (0,)))
        for problem in (self._near, self._exact):
            problem.add(Objective(near, ObjectiveType.SOS, (0,), NEARNESS))

    def T_obj_ee(self, q: np.ndarray) -> np.ndarray:
        """End-effector frames (K, 7) at configurations (K, n), object frame."""
        T_world_ee = self._manipulation.workspace.end_effectors(self._manipulation.robot, q)
        return multiply_all(self._T_obj_world, T_world_ee)

    def configurations(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Random configurations (count, n)."""
        return rng.uniform(self._chain.lower, self._chain.upper, (count, len(self.home)))

    def near(self, points: np.ndarray, R: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Configurations (K, n) with the end effector near points (K, 3) and orientations R (K, 3, 3)."""
        params, q = self._pose(np.zeros_like(points), points, R), np.tile(start, (len(R), 1))
        for _ in range(2):  # inverse kinematics stays near where it begins
            q = solve_ik_batch(self._near, params, q, q)[0]
        return q

    def exact(self, constraint: _Constraint, R: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Configurations (K, n) in which the contacts are made near orientations R (K, 3, 3).

        The point of the hand that touches depends on the orientation, so both are found in turns, from
        configurations q (K, n) near that.

        Returns:
            The configurations, and (K,) whether the contacts are made.
        """
        q, made = q.copy(), np.zeros(len(q), bool)
        todo = np.arange(len(q))
        for turn in range(TURNS):
            own = constraint[todo]
            points, targets, _ = own.points(self.T_obj_ee(q[todo]))
            params = [self._pose(points, targets, R[todo])]
            if own.axis is not None and own.direction is not None:
                R_tip, R_obj = rotation_matrix(self._manipulation.T_tip_ee), rotation_matrix(self._T_world_obj)
                params.insert(0, np.concatenate([own.axis @ R_tip.T, own.direction @ R_obj.T], axis=1))
            in_tip, in_world = apply(self._manipulation.T_tip_ee, points), apply(self._T_world_obj, targets)
            found, solved = solve_ik_batch(
                self._exact, np.concatenate([in_tip, in_world, *params], axis=1), q[todo], q[todo]
            )
            q[todo] = found
            made[todo] = solved & own.fulfilled(self.T_obj_ee(found))
            # the second turn comes nearer to R, since inverse kinematics stays near where it begins
            todo = todo[solved & (~made[todo] | (turn == 0))]
            if not len(todo):
                break
        return q, made

    def _pose(self, points: np.ndarray, targets: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Parameters (K, 24) of the pose of points of the hand, end-effector frame, at targets with orientations R."""
        K, T_tip_ee = len(R), self._manipulation.T_tip_ee
        R_tip = np.tile(rotation_matrix(T_tip_ee).ravel(), (K, 1))
        R_world = (rotation_matrix(self._T_world_obj) @ R).reshape(K, 9)
        return np.concatenate([apply(T_tip_ee, points), R_tip, apply(self._T_world_obj, targets), R_world], axis=1)


def _axes_within_reach(
    solver: _FrameSolver, contacts: list[ContactPoint], body: Body, own: Solids, hand: Hand, up: np.ndarray
) -> list[ContactPoint]:
    """Grasps about closing axes that the arm reaches, where the object's form allows that; every other one upright."""
    T_obj_ee = np.array([contact.T_obj_ee for contact in contacts])
    wanted = rotation_matrices(T_obj_ee)
    axes = wanted[:, :, 1].copy()
    wanted[::2] = _upright(wanted[::2], up)
    near = rotation_matrices(solver.T_obj_ee(solver.near(T_obj_ee[:, :3], wanted, solver.home)))
    other = np.linalg.norm(near[:, :, 1] - axes, axis=1) > SAME_AXIS
    other[::2] = True
    index = np.flatnonzero(other).tolist()
    chosen = [contacts[k] for k in index]
    turned = turned_grasps(chosen, near[index], own, hand, lambda points: in_regions(points, body.graspable))
    return [dict(zip(index, turned, strict=True)).get(k, contact) for k, contact in enumerate(contacts)]


def _upright(R: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Orientations (K, 3, 3) with the z axis down and the y axis as it is seen from above; as they are without one."""
    y = R[:, :, 1] - np.outer(R[:, :, 1] @ up, up)
    length = np.linalg.norm(y, axis=1)
    y /= np.maximum(length, LEVEL)[:, None]
    down = np.tile(-up, (len(R), 1))
    return np.where((length >= LEVEL)[:, None, None], frames(down, np.cross(y, down)), R)


def _placed(
    solver: _FrameSolver, constraint: _Constraint, R: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[int, ContactPoint, np.ndarray]]:
    """Contacts that the arm reaches, near orientations R (K, 3, 3): index, contact, and configuration (n,)."""
    made, q = np.zeros(len(R), bool), np.zeros((len(R), len(solver.home)))
    starts = [solver.home, *solver.configurations(RESTARTS, rng)]
    for slides in (False, True):
        own = replace(constraint, slides=slides)
        for start in starts:
            todo = np.flatnonzero(~made)
            if len(todo):
                near = solver.near(constraint.surface[todo], R[todo], start)
                q[todo], made[todo] = solver.exact(own[todo], R[todo], near)
        if made.any() or constraint.contacts[0].kind == ContactKind.GRASP:
            break
    T_obj_ee = solver.T_obj_ee(q)
    for k in np.flatnonzero(made).tolist():
        yield k, _turned(constraint.contacts[k], T_obj_ee[k]), q[k]


def _turned(contact: ContactPoint, T_obj_ee: np.ndarray) -> ContactPoint:
    """The contact with another frame T_obj_ee (7,). Fingers still approach along themselves, pushers the surface."""
    if contact.kind == ContactKind.GRASP:
        return replace(contact, T_obj_ee=T_obj_ee)
    way = rotation_matrix(contact.T_obj_ee) @ contact.approach
    return replace(contact, T_obj_ee=T_obj_ee, approach=rotation_matrix(T_obj_ee).T @ way)


def _distinct(found: list[tuple[ContactPoint, np.ndarray]]) -> list[tuple[ContactPoint, np.ndarray]]:
    """Contacts and configurations without those whose frame and approach are nearly those of an earlier one."""
    if not found:
        return []
    T = np.array([contact.T_obj_ee for contact, _ in found])
    R = rotation_matrices(T)
    ways = np.einsum("kij,kj->ki", R, [contact.approach for contact, _ in found])
    keys = np.round(np.concatenate([T[:, :3], R.reshape(len(R), 9), ways], axis=1) / SAME_FRAME)
    _, first = np.unique(keys, axis=0, return_index=True)
    return [found[k] for k in np.sort(first)]


def _followed(
    manipulation: Manipulation, found: list[tuple[ContactPoint, np.ndarray]], object_poses: np.ndarray
) -> list[ContactPoint]:
    """The contacts that the arm can draw back from and begin the path with, the ones with the longest part first."""
    if not found:
        return []
    contacts = [contact for contact, _ in found]
    q = np.array([configuration for _, configuration in found])
    problem = manipulation.ik_problem(CollisionModel(), Phase.TRANSIT)
    T_contacts = np.array([contact.T_obj_ee for contact in contacts])
    back = np.concatenate([drawn_back(contacts), T_contacts[:, 3:]], axis=1)

    def reach(T_world_obj: np.ndarray, T_obj_ee: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        targets = pose_params_all(manipulation.T_tip_ee, multiply_all(T_world_obj, T_obj_ee))
        return solve_ik_batch(problem, targets, q, q)

    M = len(object_poses)
    _, follows = reach(object_poses[0], back)
    served = follows.astype(int)
    first = min(FIRST_PLACE, M - 1)
    for place in np.unique(np.linspace(first, M - 1, PLACES).round().astype(int)) if M > 1 else ():
        q, reached = reach(object_poses[place], T_contacts)
        follows &= reached
        served += follows
    least = 1 if M == 1 else 2
    return [contacts[k] for k in np.argsort(-served, kind="stable") if served[k] >= least]
