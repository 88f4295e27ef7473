"""The centre of mass of bodies."""

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import ConvexSet

BODIES_KEPT = 256  # bodies whose centre of mass is cached


@lru_cache(maxsize=BODIES_KEPT)
def centre_of_mass(body: ConvexSet) -> np.ndarray:
    """Centroid (3,) in the body frame, m, of shapes with the same density; overlaps count twice."""
    total, moment = 0.0, np.zeros(3)
    for k in range(len(body)):
        hull, r = body.hull(k), body.radius[k]
        center, volume = (body.center[k], 4.0 / 3.0 * np.pi * body.bound[k] ** 3)
        if r == 0.0 and len(hull) > 3:
            center, volume = _centroid(hull)
        total += volume
        moment += volume * center
    return moment / total


def _centroid(hull: np.ndarray) -> tuple[np.ndarray, float]:
    inside = hull.mean(0)
    a, b, c = (hull[ConvexHull(hull).simplices[:, k]] - inside for k in range(3))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6.0
    return inside + (volume[:, None] * (a + b + c) / 4.0).sum(0) / volume.sum(), float(volume.sum())
