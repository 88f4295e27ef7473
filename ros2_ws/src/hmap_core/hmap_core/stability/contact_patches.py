"""Where two convex shapes touch: the corners of their common face, edge or point, and the normal there."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet, signed_distance

TOUCHING = 1e-3  # m; shapes that are nearer touch
FEATURE = 1e-4  # m; vertices this near to the foremost one belong to the face or edge that touches
APART = 1e-5  # m by which shapes are moved apart that touch without any depth, where the normal is not defined
SAME_POINT = 1e-6  # m
_R, _P = np.eye(3), np.zeros(3)


@dataclass(frozen=True)
class ContactPatch:
    """A face, an edge or a point at which a body rests on another one.

    Attributes:
        points: (n, 3) its corners, world frame.
        normal: (3,) unit vector into the body.
        friction: lateral Coulomb coefficient.
    """

    points: np.ndarray
    normal: np.ndarray
    friction: float


def patches(body: ConvexSet, other: ConvexSet, friction: float) -> list[ContactPatch]:
    """Patches at which a body touches another one; both sets are in the world frame."""
    found = []
    for a in range(len(body)):
        for b in range(len(other)):
            apart = np.linalg.norm(body.center[a] - other.center[b]) - body.bound[a] - other.bound[b]
            if apart > TOUCHING:
                continue
            patch = _patch(body.hull(a), body.radius[a], other.hull(b), other.radius[b])
            if patch is not None:
                found.append(ContactPatch(*patch, friction))
    return found


def _patch(A: np.ndarray, ra: float, B: np.ndarray, rb: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners (n, 3) and normal (3,) into the first of two swept hulls; None where they do not touch."""
    witness = np.empty((3, 3))
    depth = signed_distance(A, _R, _P, ra, B, _R, _P, rb, witness)
    if depth > TOUCHING:
        return None
    if abs(depth) < APART:
        away = A.mean(axis=0) - B.mean(axis=0)
        signed_distance(A, _R, 3.0 * APART * away / np.linalg.norm(away), ra, B, _R, _P, rb, witness)
    normal = witness[0].copy()
    ahead, behind = A @ normal, B @ normal
    own = A[ahead <= ahead.min() + FEATURE] - ra * normal
    theirs = B[behind >= behind.max() - FEATURE] + rb * normal
    axes = np.linalg.svd(normal[None])[2][1:]
    common = intersection((own - witness[1]) @ axes.T, (theirs - witness[1]) @ axes.T)
    return (witness[1] + common @ axes if len(common) else witness[1:2].copy()), normal


def intersection(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Corners (k, 2) of the intersection of the hulls of two sets of points (n, 2), (m, 2) in a plane.

    The hull of either may be a polygon, a segment or a point. The result is empty if two segments cross at an angle.
    """
    a, b = _corners(a), _corners(b)
    if len(a) > len(b):
        a, b = b, a
    if len(b) >= 3:
        return _clipped(a, b)
    if len(a) == 1 or len(b) == 1:
        return a if len(a) == 1 else b
    along = (b[1] - b[0]) / np.linalg.norm(b[1] - b[0])
    off = np.abs((a - b[0]) @ [-along[1], along[0]])
    if off.max() > FEATURE:
        return np.zeros((0, 2))
    ends = np.sort((a - b[0]) @ along), np.sort((b - b[0]) @ along)
    low, high = max(e[0] for e in ends), min(e[1] for e in ends)
    return b[0] + np.outer([low, high], along) if high >= low else np.zeros((0, 2))


def _corners(points: np.ndarray) -> np.ndarray:
    """Counter-clockwise corners of the hull of points (n, 2); two ends if they lie on a line, one if at a point."""
    try:
        return points[ConvexHull(points).vertices] if len(points) >= 3 else _ends(points)
    except QhullError:
        return _ends(points)


def _ends(points: np.ndarray) -> np.ndarray:
    middle = points.mean(axis=0)
    first = points[np.linalg.norm(points - middle, axis=1).argmax()]
    last = points[np.linalg.norm(points - first, axis=1).argmax()]
    return np.array([first]) if np.linalg.norm(first - last) < SAME_POINT else np.array([first, last])


def _clipped(subject: np.ndarray, window: np.ndarray) -> np.ndarray:
    """A polygon, segment or point inside a convex counter-clockwise polygon (Sutherland & Hodgman 1974)."""
    for a, b in zip(window, np.roll(window, -1, axis=0), strict=True):
        inside = (b - a)[0] * (subject[:, 1] - a[1]) - (b - a)[1] * (subject[:, 0] - a[0])
        kept: list[np.ndarray] = []
        pairs = range(len(subject)) if len(subject) > 2 else range(len(subject) - 1)
        for k in range(len(subject)):
            if inside[k] >= -SAME_POINT:
                kept.append(subject[k])
            after = (k + 1) % len(subject)
            if k in pairs and (inside[k] > 0.0) != (inside[after] > 0.0):
                share = inside[k] / (inside[k] - inside[after])
                kept.append(subject[k] + share * (subject[after] - subject[k]))
        if not kept:
            return np.zeros((0, 2))
        subject = np.array(kept)
    return subject
