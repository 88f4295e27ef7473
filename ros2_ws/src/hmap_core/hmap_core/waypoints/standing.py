"""Where on its path a body could be let go of: it stands there by itself."""

from collections import namedtuple
from collections.abc import Sequence

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import Body
from hmap_core.waypoints.support import FACE_TOLERANCE, Support

# poses whose height (m) and tilt differ by less stand on the same support
SAME = 1e-6
_Shapes = namedtuple("_Shapes", "hulls")


def standing(body: Body, poses: np.ndarray, obstacles: Sequence[Body]) -> np.ndarray:
    """Whether the body stands stably at each of its poses (M, 7) on the obstacles, which are at their own poses; (M,).

    A body that rests at the first pose in a way not understood here (a ball) counts as standing wherever it has the
    same height and tilt.
    """
    own = convex_set(body.shapes)
    sets = [(other, convex_set(other.shapes)) for other in obstacles]
    hulls = [(apply(o.pose, shapes.hull(s)), shapes.radius[s]) for o, shapes in sets for s in range(len(shapes))]
    tops = np.array([points[:, 2].max() + radius for points, radius in hulls])
    stands = np.zeros(len(poses), bool)
    support, reference = None, None
    for m, T in enumerate(poses):
        carrying = np.abs(tops - _lowest(own, T)) <= FACE_TOLERANCE
        if not carrying.any():
            continue
        if reference is None or not _alike(reference, T):
            support, reference = Support(own, _Shapes(hulls), carrying, T), T
        stands[m] = support.holds(T)
    if not stands[0]:
        stands |= np.array([_alike(poses[0], T) for T in poses])
    return stands


def _lowest(body: ConvexSet, T: np.ndarray) -> float:
    height = body.vertices @ rotation_matrix(T)[2] + T[2]
    return min(height[body.start[s] : body.start[s + 1]].min() - body.radius[s] for s in range(len(body)))


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two poses differ by planar motion only."""
    tilt = rotation_matrix(a)[2] - rotation_matrix(b)[2]
    return bool(abs(a[2] - b[2]) < SAME and np.abs(tilt).max() < SAME)
