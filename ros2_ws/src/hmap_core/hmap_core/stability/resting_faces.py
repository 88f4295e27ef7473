"""The faces of a body's convex hull on which it stands by itself (Wiegley, Rao, Goldberg, "Computing a statistical
distribution of stable poses for a polyhedron", 1992).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet
from hmap_core.transforms import quaternions

SAME_NORMAL = 1e-6  # 1 - cosine, below which facets of the hull belong to one face
SAME_PLANE = 1e-5  # m, the same of their distances from the origin
LEAST_TILT = float(np.tan(np.deg2rad(6.0)))  # a body that falls over when it is tilted by less does not stand
LEAST_INSIDE = 0.004  # m, distance of the centre of mass from the edge of the face
BALL_POINTS = 200  # points of a swept shape's surface, on which no face may lie
BODIES_KEPT = 256  # bodies whose faces are cached


@dataclass(frozen=True)
class RestingFace:
    """A face on which a body stands.

    Attributes:
        R: (3, 3) rotation from the body frame to level axes in which the face is below and horizontal.
        height: m, of the body's origin above the face.
        steadiness: tangent of the tilt at which the body falls over.
    """

    R: np.ndarray
    height: float
    steadiness: float


@lru_cache(maxsize=BODIES_KEPT)
def resting_faces(body: ConvexSet, centre: tuple[float, float, float]) -> tuple[RestingFace, ...]:
    """The faces on which a body stands on level ground, the steadiest first.

    The side of a cylinder is none: the body would roll.

    Args:
        body: its shapes.
        centre: its centre of mass, body frame, m.
    """
    points, solid = _points(body)
    try:
        hull = ConvexHull(points)
    except QhullError:
        return ()
    centre_of_mass = np.array(centre)
    faces, seen = [], np.zeros(len(hull.equations), bool)
    for k, (*normal, offset) in enumerate(hull.equations):
        if seen[k]:
            continue
        n = np.array(normal)
        same = (hull.equations[:, :3] @ n > 1.0 - SAME_NORMAL) & (np.abs(hull.equations[:, 3] - offset) < SAME_PLANE)
        seen |= same
        corners = np.unique(hull.simplices[same])
        if not solid[corners].all():
            continue
        height = float(-offset - n @ centre_of_mass)
        R = level_rotation(n)
        inside = _inside((points[corners] @ R.T)[:, :2], (R @ centre_of_mass)[:2])
        if inside >= max(LEAST_INSIDE, LEAST_TILT * height):
            faces.append(RestingFace(R, float(-offset), inside / max(height, LEAST_INSIDE)))
    return tuple(sorted(faces, key=lambda face: -face.steadiness))


def level_rotation(normal: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) that turns a unit vector (3,) of the body downwards, by the smallest angle."""
    axis = np.cross(normal, [0.0, 0.0, -1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(-normal[2])
    if sine < 1e-9:
        return np.eye(3) if cosine > 0.0 else np.diag([1.0, -1.0, -1.0])
    x, y, z = axis / sine
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sine * K + (1.0 - cosine) * K @ K


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """The quaternion (4,) xyzw of a rotation (3, 3)."""
    return quaternions(R[None])[0]


def _points(body: ConvexSet) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) that span the body's hull, and whether (V,) each belongs to a shape with flat faces."""
    points, solid = [], []
    for k in range(len(body)):
        hull, radius = body.hull(k), body.radius[k]
        if radius > 0.0:
            hull = (hull[:, None] + radius * _unit_ball()).reshape(-1, 3)
        points.append(hull)
        solid.append(np.full(len(hull), radius == 0.0))
    return np.concatenate(points), np.concatenate(solid)


@lru_cache(maxsize=1)
def _unit_ball() -> np.ndarray:
    z = np.linspace(-1.0, 1.0, BALL_POINTS)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(BALL_POINTS)  # Fibonacci lattice
    return np.column_stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z])


def _inside(points: np.ndarray, centre: np.ndarray) -> float:
    """Distance (m) of a point (2,) from the edge of the hull of points (n, 2); negative outside."""
    equations = ConvexHull(points).equations
    return float(-(equations[:, :2] @ centre + equations[:, 2]).max())
