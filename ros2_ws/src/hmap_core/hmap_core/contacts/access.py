"""Accessibility of surface points: free space in front of them, and material behind the whole contact."""

import numpy as np
from numba import njit

from hmap_core.contacts.camera import COVER, SKIN, Cloud
from hmap_core.contacts.solids import Solids, covered, interval
from hmap_core.transforms import apply, rotation_matrix


@njit(cache=True, error_model="numpy", nogil=True)
def _free_ahead(points, normals, room, kind, R, p, size, planes, start):
    """Whether (N,) the line of length ``room`` from each point along its normal intersects no solid."""
    out = np.ones(points.shape[0], np.bool_)
    t = np.empty(2)
    for i in range(points.shape[0]):
        for s in range(kind.shape[0]):
            interval(s, points[i], normals[i], kind, R, p, size, planes, start, t)
            if t[0] <= t[1] and t[1] > SKIN and t[0] < room:
                out[i] = False
                break
    return out


def accessible(cloud: Cloud, T_world_obj: np.ndarray, obstacles: Solids, room: float) -> np.ndarray:
    """Test for free space in front of surface points.

    Args:
        cloud: points of the object, object frame.
        T_world_obj: (7,) the object's pose.
        obstacles: in the world frame.
        room: required free length along the normals, m.

    Returns:
        (N,) whether the space is free.
    """
    points = apply(T_world_obj, cloud.points)
    normals = np.ascontiguousarray(cloud.normals @ rotation_matrix(T_world_obj).T)
    return _free_ahead(points, normals, room, *obstacles.arrays)


@njit(cache=True, error_model="numpy", nogil=True)
def on_face(points, normals, sides, steps, kind, R, p, size, planes, start):
    """Largest of ``steps`` (K,) for which points + step * sides (N, 3) still has material behind it, (N,)."""
    out = np.zeros(points.shape[0])
    for i in range(points.shape[0]):
        for k in range(steps.shape[0]):
            if covered(points[i] + steps[k] * sides[i] - COVER * normals[i], kind, R, p, size, planes, start):
                out[i] = steps[k]
                break
    return out
