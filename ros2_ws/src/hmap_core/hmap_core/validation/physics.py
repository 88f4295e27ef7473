"""Limits of friction, gripper opening and geometry, for plans in physical mode.

Pushing is quasi-static (Lynch and Mason, "Stable pushing: mechanics, controllability, and planning", 1996). Friction
with the support answers a planar motion (v, w) of the centre of mass with a force along -v and a torque along -c^2 w.
The length c of the ellipsoidal limit surface is the mean distance of the footprint from the centre of mass, which is
exact at both ends of the ellipsoid for evenly distributed weight. The pusher has to supply the opposite wrench, with
forces inside the friction cones at the corners of the contact patch.
"""

from functools import lru_cache

import numpy as np
import scipy
from scipy.spatial import Delaunay

from hmap_core.validation import limits, rigid
from hmap_core.validation.contacts import Contact
from hmap_core.validation.geometry import Polytope, polytope_points
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import center_of_mass, overlap
from hmap_core.validation.world import Part, World

MIN_FACE_WIDTH = 1e-4  # m, width below which a support face counts as an edge
MIN_HORIZONTAL = 1e-6  # smallest horizontal part of a unit normal that can push sideways


def _patch(world: World, tip: Part, target: Part, k: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The contact patch of two parts at sample k, world frame.

    Returns:
        Its corners (n, 3) and the unit normal (3,) into the target; None if the parts do not touch.
    """
    a, b = world.tracks[tip], world.tracks[target]
    distance, _, point, normal = world.gauge(tip, target).witness(a.at(k), b.at(k))
    if distance > limits.CONTACT_GAP:
        return None
    pressed = Polytope.around(tip.solid, a.R[k], a.p[k] + limits.CONTACT_GAP * normal)
    corners = overlap(pressed, Polytope.around(target.solid, b.R[k], b.p[k]))
    return (point[None] if corners is None else corners), normal


def patches(contact: Contact) -> list[tuple[np.ndarray, np.ndarray]]:
    """The contact patches at the first sample: corners (n, 3) and the unit normal (3,) into the object, world frame."""
    world, k = contact.world, contact.segment.first
    targets = world.parts_of(contact.object)
    found = [_patch(world, a, b, k) for parts in contact.touching.values() for a in parts for b in targets]
    return [patch for patch in found if patch is not None]


def friction_of(contact: Contact) -> float:
    """Lateral friction coefficient of the contact: the lower one of the object and of the tool or fingers."""
    bodies = contact.world.document.bodies
    robot = contact.world.arms[contact.robot].data
    pusher = bodies[contact.segment.manipulator].friction if contact.by_tool else robot.finger_friction
    return min(bodies[contact.object].friction, pusher)


def _edges(normal: np.ndarray, friction: float) -> list[np.ndarray]:
    """The two edges (2,) of the friction cone in the horizontal plane; none for a vertical normal."""
    flat = np.linalg.norm(normal[:2])
    if flat < MIN_HORIZONTAL:
        return []
    n = normal[:2] / flat
    return [n + sign * friction * np.array([-n[1], n[0]]) for sign in (-1.0, 1.0)]


def _wrenches(contact: Contact, length: float) -> np.ndarray:
    """Generators (3, m) of the feasible wrenches about the centre of mass: force, and torque / ``length``."""
    center = center_of_mass(contact.world, contact.object, contact.segment.first)
    friction = friction_of(contact)
    columns = []
    for points, normal in patches(contact):
        for edge in _edges(normal, friction):
            for x, y in points[:, :2] - center[:2]:
                columns.append([*edge, (x * edge[1] - y * edge[0]) / length])
    return np.unique(np.round(columns, 9), axis=0).T if columns else np.zeros((3, 0))


@lru_cache(maxsize=1)
def _barycentric() -> np.ndarray:
    """Weights (36, 3) of the centroids of 36 congruent parts of a triangle."""
    n = 6
    up = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    down = [(3 * i + 2, 3 * j + 2) for i in range(n) for j in range(n - i - 1)]
    ab = np.array(up + down) / (3.0 * n)
    return np.column_stack([ab, 1.0 - ab.sum(axis=1)])


def _characteristic_length(contact: Contact) -> float:
    """Mean distance in metres of the object's footprint from its centre of mass, in the horizontal plane."""
    return footprint_length(contact, center_of_mass(contact.world, contact.object, contact.segment.first)[:2])


def footprint_length(contact: Contact, center: np.ndarray) -> float:
    """Mean distance in metres of the object's footprint from a point (2,), at the start of a contact, world frame."""
    world, k = contact.world, contact.segment.first
    tracks = [world.tracks[part] for part in world.parts_of(contact.object)]
    faces = _footprint([polytope_points(t.part.solid, t.R[k], t.p[k]) for t in tracks])
    triangles = np.concatenate([face[Delaunay(face).simplices] for face in faces]) - center
    side_a, side_b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    areas = np.abs(side_a[:, 0] * side_b[:, 1] - side_a[:, 1] * side_b[:, 0])
    distances = np.linalg.norm(np.einsum("bc,tcx->tbx", _barycentric(), triangles), axis=2).mean(axis=1)
    return float(areas @ distances / areas.sum())


def _footprint(parts: list[np.ndarray]) -> list[np.ndarray]:
    """The faces on which an object stands.

    If the object stands on no face, its whole vertical projection is returned.

    Args:
        parts: vertices (n, 3) of each part, world frame.

    Returns:
        Corners (m, 2) of one face for each part that has one.
    """
    lowest = min(points[:, 2].min() for points in parts)
    low = [points[points[:, 2] <= lowest + limits.SUPPORT_GAP, :2] for points in parts]
    faces = [face for face in low if len(face) >= 3 and np.linalg.svd(face - face.mean(0))[1][-1] > MIN_FACE_WIDTH]
    return faces or [np.vstack(parts)[:, :2]]


def motions(contact: Contact, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Planar velocities of the centre of mass in the steps in which the object moves.

    The axes are those of the world at the start of the contact, rotated with the object since then.

    Returns:
        (n, 3) linear velocity and angular velocity times ``length``, m/s; and the samples (n,) at which the steps
        begin.
    """
    world, first, last = contact.world, contact.segment.first, contact.segment.last
    R, p = (values[first : last + 1] for values in world.state.bodies[contact.object])
    local = R[0].T @ (center_of_mass(world, contact.object, first) - p[0])
    velocity = np.diff(p + R @ local, axis=0) / world.document.dt
    turned = R[:-1] @ R[0].T
    velocity = (np.swapaxes(turned, -1, -2) @ velocity[..., None])[..., 0]
    step, _ = rigid.relative(R[:-1], p[:-1], R[1:], p[1:])
    about_z = R[:-1] @ step @ np.swapaxes(R[:-1], -1, -2)
    spin = np.arctan2(about_z[:, 1, 0] - about_z[:, 0, 1], about_z[:, 0, 0] + about_z[:, 1, 1]) / world.document.dt
    motion = np.column_stack([velocity[:, :2], spin * length])
    moving = np.linalg.norm(motion, axis=1) > limits.PUSH_SPEED
    return motion[moving], first + np.flatnonzero(moving)


def _cone_angle(wrenches: np.ndarray, motion: np.ndarray) -> float:
    """Angle in radians between the wrench that a motion (3,) requires and the nearest feasible wrench.

    Args:
        wrenches: (3, m) generators of the feasible cone.
        motion: (3,).
    """
    needed = motion / np.linalg.norm(motion)
    if wrenches.shape[1] == 0:
        return np.pi / 2.0
    _, residual = scipy.optimize.nnls(wrenches, needed)
    return float(np.arcsin(np.clip(residual, 0.0, 1.0)))


def _check_push(contact: Contact, findings: Findings) -> None:
    length = _characteristic_length(contact)
    wrenches = _wrenches(contact, length)
    moves, samples = motions(contact, length)
    for motion, k in zip(moves, samples, strict=True):
        angle, limit = np.degrees(_cone_angle(wrenches, motion)), np.degrees(limits.FRICTION_CONE_SLACK)
        findings.check(Kind.FRICTION_CONE, contact.bodies, contact.world.document.time[k], angle, limit)


def _check_grasp(contact: Contact, findings: Findings) -> None:
    gripper = contact.world.arms[contact.robot].data.gripper
    if gripper is None or contact.by_tool:
        return
    openings = contact.world.document.gripper[contact.robot][contact.window]
    for k, bound in ((int(openings.argmin()), gripper.min_opening), (int(openings.argmax()), gripper.max_opening)):
        excess = (openings[k] - bound) * (1.0 if bound == gripper.max_opening else -1.0)
        if excess > limits.OPENING_SLACK:
            time = contact.world.document.time[contact.segment.first + k]
            findings.add(Kind.GRASP_WIDTH, contact.bodies, time, openings[k], bound, excess)


def check(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Reports contacts that are infeasible under friction and gravity; in physical mode only."""
    if world.document.mode != "physical":
        return
    for contact in contacts:
        if contact.kind == "touch":
            findings.add(Kind.NOT_PHYSICAL, contact.bodies, contact.segment.start, 1.0, 0.0, 1.0)
        elif contact.kind == "grasp":
            _check_grasp(contact, findings)
        elif contact.kind == "push":
            _check_push(contact, findings)
