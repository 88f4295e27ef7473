"""Pushes: closed fingers against a side of an object that slides on its support."""

import numpy as np
from numba import njit

from hmap_core.collision.convex import convex_set
from hmap_core.contacts import scoring
from hmap_core.contacts.camera import COVER, Cloud
from hmap_core.contacts.candidates import Candidates, Hand, Situation, frames, on_surface
from hmap_core.contacts.friction import characteristic_length, stable_pushes
from hmap_core.contacts.solids import Solids, covered
from hmap_core.transforms import inverse, multiply, rotation_matrix
from hmap_core.types import Body, ContactKind
from hmap_core.waypoints.support import feet

# a face this near to upright can be pushed, rad
UPRIGHT = float(np.deg2rad(10.0))
# lean of the fingers from pointing straight down towards pointing at the face, rad
LEANS = np.deg2rad([0.0, 30.0, 60.0, 90.0])
# turns of the hand about its approach: pads' faces or flanks against the object
ROLLS = np.deg2rad([0.0, 90.0, 180.0, 270.0])
# share of the object's friction coefficient that a push counts on
FRICTION_SHARE = 0.8
# fingers end at least this high over the support, m
MIN_HEIGHT = 0.01
# a motion that rises or tilts by more than this is not a slide
MAX_RISE = 1e-3  # m
MAX_TILT = float(np.deg2rad(1.0))
# steps by which a contact line is shortened to end on the face
SHRINKING = np.linspace(1.0, 0.0, 11)


def slide_twists(T0: np.ndarray, T1: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Twists (2, 3) vx, vy, w of the object's ``centre`` (3,) at both ends of a slide, in level axes fixed to it.

    The level axes are those of the world while the object is at T0. None when T1 is not reached from T0 on a plane.
    """
    turn = multiply(np.r_[np.zeros(3), T1[3:]], inverse(np.r_[np.zeros(3), T0[3:]]))[3:]
    turn = turn if turn[3] >= 0.0 else -turn
    angle = 2.0 * np.arctan2(turn[2], turn[3])
    tilt = 2.0 * np.arcsin(min(1.0, float(np.hypot(turn[0], turn[1]))))
    step = T1[:3] - T0[:3]
    if abs(step[2]) > MAX_RISE or tilt > MAX_TILT:
        return None
    arm = rotation_matrix(T0) @ centre
    spin = angle * np.array([-arm[1], arm[0]])
    c, s = np.cos(angle), np.sin(angle)
    last = np.array([c * step[0] + s * step[1], -s * step[0] + c * step[1]])
    return np.array([[*(step[:2] + spin), angle], [*(last + spin), angle]])


@njit(cache=True, error_model="numpy", nogil=True)
def _on_face(points, normals, sides, steps, kind, R, p, size, planes, start):
    """Largest of ``steps`` (K,) for which points + step * sides (N, 3) still has material right behind it, (N,)."""
    out = np.zeros(points.shape[0])
    for i in range(points.shape[0]):
        for k in range(steps.shape[0]):
            if covered(points[i] + steps[k] * sides[i] - COVER * normals[i], kind, R, p, size, planes, start):
                out[i] = steps[k]
                break
    return out


def _oriented(n: int, normals: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames (n * K, 3, 3) for every lean and roll, and the horizontal tangents (n * K, 3)."""
    lean = np.tile(np.repeat(LEANS, len(ROLLS)), n)
    roll = np.tile(ROLLS, n * len(LEANS))
    count = len(LEANS) * len(ROLLS)
    inward = -(normals - np.outer(normals @ up, up))
    inward = np.repeat(inward / np.linalg.norm(inward, axis=1)[:, None], count, axis=0)
    z = -np.cos(lean)[:, None] * up + np.sin(lean)[:, None] * inward
    tangent = np.cross(up, inward)
    x = np.cos(roll)[:, None] * tangent + np.sin(roll)[:, None] * np.cross(z, tangent)
    return frames(z, x), tangent


def pushes(
    body: Body, cloud: Cloud, own: Solids, centre: np.ndarray, radius: float, hand: Hand, situation: Situation
) -> Candidates | None:
    """Pushes that carry the object to its next pose, sticking and without toppling it; None when it does not slide.

    The line of contact is the part of the closed fingertips that lies against the face.
    """
    if situation.T_world_next is None:
        return None
    twists = slide_twists(situation.T_world_obj, situation.T_world_next, centre)
    if twists is None:
        return None
    level = rotation_matrix(situation.T_world_obj)  # object frame to level axes
    shapes = convex_set(body.shapes)
    footprint, lowest = feet(shapes, level)
    if not footprint:
        return None
    up = level[2]
    cloud = cloud[(np.abs(cloud.normals @ up) <= np.sin(UPRIGHT)) & (cloud.points @ up >= lowest + MIN_HEIGHT)]
    count = len(LEANS) * len(ROLLS)
    R, tangent = _oriented(len(cloud), cloud.normals, up)
    points, normals = (np.repeat(a, count, axis=0) for a in (cloud.points, cloud.normals))
    origin, feature = on_surface(R, points, normals, hand.tip)
    ends = _contact_lines(points, normals, tangent, R, origin, feature, hand.tip, own)
    flat = _leveled(normals, level)
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    middle = (level @ centre)[:2]
    arms = np.stack([_leveled(e, level) for e in ends], axis=1) - middle
    length = characteristic_length(footprint, middle)
    keep = stable_pushes(arms, flat, FRICTION_SHARE * body.friction, twists, length)
    keep &= _stays_upright(points @ up - lowest, flat, footprint, middle, body.friction)
    score = (
        scoring.W_CENTRAL * scoring.central(points, centre, radius)
        + scoring.W_ABOVE * scoring.above(R, situation.T_world_obj)
        + scoring.W_NEAR * scoring.near(points, situation, radius)
        + scoring.W_MOTION * scoring.along(normals, situation)
        + scoring.W_SEEN * np.repeat(cloud.seen, count)
    )
    approach = -np.einsum("nij,ni->nj", R, normals)
    chosen = (R, origin, points, normals, np.zeros(len(points)), approach, score)
    return Candidates(ContactKind.PUSH, *(a[keep] for a in chosen))


def _leveled(vectors: np.ndarray, level: np.ndarray) -> np.ndarray:
    return (vectors @ level.T)[:, :2]


def _contact_lines(points, normals, tangent, R, origin, feature, tip, own) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (N, 3) of the line in which the fingertips lie against the face, cut off where the face ends."""
    reach = np.einsum("nij,ni->nj", R, tangent) @ tip.T + np.einsum("ni,ni->n", origin - points, tangent)[:, None]
    high = np.where(feature, reach, -np.inf).max(axis=1)
    low = np.where(feature, reach, np.inf).min(axis=1)
    ends = []
    for side in (low, high):
        offset = tangent * side[:, None]
        ends.append(points + offset * _on_face(points, normals, offset, SHRINKING, *own.arrays)[:, None])
    return ends[0], ends[1]


def _stays_upright(height, flat, footprint, middle, friction) -> np.ndarray:
    """Whether (N,) the object pushed at ``height`` (N,) m slides rather than topples over its leading edge."""
    corners = np.concatenate(footprint) - middle
    lead = (-flat @ corners.T).max(axis=1)
    return friction * height <= lead
