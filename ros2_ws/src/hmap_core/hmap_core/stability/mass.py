"""The centre of mass of bodies."""

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import ConvexSet

MANY_SHAPES = 32  # of a body from which on its boxes are computed together
SAME_CORNER = 1e-9  # m
BODIES_KEPT = 256  # bodies whose centre of mass is cached


@lru_cache(maxsize=BODIES_KEPT)
def centre_of_mass(body: ConvexSet) -> np.ndarray:
    """Centroid (3,) in the body frame, m, of shapes with the same density; overlaps count twice."""
    boxes = _boxes(body) if len(body) >= MANY_SHAPES else np.zeros(len(body), bool)
    total, moment = 0.0, np.zeros(3)
    if boxes.any():
        corners = body.vertices[body.start[:-1][boxes][:, None] + np.arange(8)]
        sides = corners[:, [4, 2, 1]] - corners[:, :1]
        volumes = np.abs(np.linalg.det(sides))
        total, moment = float(volumes.sum()), volumes @ corners.mean(axis=1)
    for k in np.flatnonzero(~boxes).tolist():
        hull, r = body.hull(k), body.radius[k]
        center, volume = (body.center[k], 4.0 / 3.0 * np.pi * body.bound[k] ** 3)
        if r == 0.0 and len(hull) > 3:
            center, volume = _centroid(hull)
        total += volume
        moment += volume * center
    return moment / total


def _boxes(body: ConvexSet) -> np.ndarray:
    """Which shapes (S,) of a body are boxes with their corners in the order of ``hull_vertices``."""
    eight = (np.diff(body.start) == 8) & (body.radius == 0.0)
    corners = body.vertices[body.start[:-1][eight][:, None] + np.arange(8)]
    first, sides = corners[:, :1], corners[:, [4, 2, 1]] - corners[:, :1]
    made = first + np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)], float) @ sides
    found = np.zeros(len(body), bool)
    found[np.flatnonzero(eight)] = np.abs(made - corners).max(axis=(1, 2), initial=0.0) <= SAME_CORNER
    return found


def _centroid(hull: np.ndarray) -> tuple[np.ndarray, float]:
    inside = hull.mean(0)
    a, b, c = (hull[ConvexHull(hull).simplices[:, k]] - inside for k in range(3))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6.0
    return inside + (volume[:, None] * (a + b + c) / 4.0).sum(0) / volume.sum(), float(volume.sum())
