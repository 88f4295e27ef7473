"""The poses of a path at which a released body stands stably."""

from collections.abc import Sequence

import numpy as np

from hmap_core.collision.convex import ConvexSet
from hmap_core.komo.shapes import body_set
from hmap_core.stability.rest import rests
from hmap_core.transforms import apply, rotation_matrices, rotation_matrix
from hmap_core.types import Body
from hmap_core.waypoints.support import FACE_TOLERANCE, Support

# poses whose height (m) and tilt differ by less have the same support
SAME = 1e-6


def stable_poses(body: Body, poses: np.ndarray, obstacles: Sequence[Body]) -> np.ndarray:
    """Test at which poses a body stands stably on obstacles.

    If the test does not understand how the body rests at the first pose (a ball, for example), the body counts as
    stable at all poses with the same height and tilt. At the first and the last pose, the equilibrium of forces decides
    about a body that stands on no flat face: in a cradle, leaning, or kept from rolling.

    Args:
        body: the body.
        poses: (M, 7) T_world_body.
        obstacles: bodies that can carry it, at their own poses.

    Returns:
        (M,) whether the body is stable.
    """
    own = body_set(body)
    up = rotation_matrices(poses)[:, 2]
    lowest = _lowest(own, up) + poses[:, 2]
    tops = [(T, shapes, s, top) for T, shapes in _posed(obstacles) for s, top in enumerate(_tops(shapes, T))]
    carrying = np.abs(np.array([top for *_, top in tops]) - lowest[:, None]) <= FACE_TOLERANCE  # (M, shapes)
    stands = np.zeros(len(poses), bool)
    todo = np.flatnonzero(carrying.any(axis=1))
    while len(todo):
        first = todo[0]
        same = _alike(poses, up, first)[todo]
        carriers = [tops[k] for k in np.flatnonzero(carrying[first])]
        hulls = [(apply(T, shapes.hull(s)), shapes.radius[s]) for T, shapes, s, _ in carriers]
        support = Support(own, hulls, poses[first])
        stands[todo[same]] = [support.is_stable(T) for T in poses[todo[same]]]
        todo = todo[~same]
    stands = stands if stands[0] else stands | _alike(poses, up, 0)
    for end in {0, len(poses) - 1}:
        stands[end] = stands[end] or rests(body, poses[end], obstacles)
    return stands


def _posed(obstacles: Sequence[Body]) -> list[tuple[np.ndarray, ConvexSet]]:
    return [(other.pose, body_set(other)) for other in obstacles]


def _tops(shapes: ConvexSet, T: np.ndarray) -> np.ndarray:
    """Height (S,) in metres of the highest point of each shape of a body at T (7,)."""
    height = shapes.vertices @ rotation_matrix(T)[2] + T[2]
    return np.maximum.reduceat(height, shapes.start[:-1]) + shapes.radius


def _lowest(body: ConvexSet, up: np.ndarray) -> np.ndarray:
    """Height (M,) in m of a body's lowest point above its origin; ``up`` (M, 3) is the vertical in its frame."""
    return (body.vertices @ up.T - np.repeat(body.radius, np.diff(body.start))[:, None]).min(axis=0)


def _alike(poses: np.ndarray, up: np.ndarray, reference: int) -> np.ndarray:
    """Which (M,) of the poses (M, 7) differ from the reference pose by planar motion only."""
    level = np.abs(poses[:, 2] - poses[reference, 2]) < SAME
    return level & (np.abs(up - up[reference]).max(axis=1) < SAME)
