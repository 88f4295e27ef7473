"""Pairs of shapes that come near each other while one body moves along a path, by axis-aligned boxes round them."""

import numpy as np

from hmap_core.collision.convex import ConvexSet
from hmap_core.transforms import rotation_matrix

WINDOW = 4  # intervals of the path for which a shape has one box
AT_ONCE = 1_000_000  # pairs of boxes that are compared together


def near_path(body: ConvexSet, path: np.ndarray, around: ConvexSet, reach: float) -> np.ndarray:
    """Pairs of a body's shapes and what stands around that may come nearer to each other than ``reach``.

    Args:
        body: in its own frame.
        path: (K, 7) its poses, one after the other.
        around: in the world frame.
        reach: m, and how far the body may leave the straight ways between the poses of its path.

    Returns:
        (m, 2) shape numbers of the body and of what stands around, in order.
    """
    low_b, high_b = _boxes(around)
    frames = [(rotation_matrix(T), T[:3]) for T in path]
    centers = np.array([body.center @ R.T + p for R, p in frames])
    found = []
    for first in range(0, max(len(path) - 1, 1), WINDOW):
        window = centers[first : first + WINDOW + 1]
        low, high = window.min(axis=0) - body.bound[:, None], window.max(axis=0) + body.bound[:, None]
        b = np.flatnonzero(_near(low_b, high_b, low.min(axis=0), high.max(axis=0), reach))
        if not len(b):
            continue
        a = np.flatnonzero(_near(low, high, low_b[b].min(axis=0), high_b[b].max(axis=0), reach))
        for some in np.array_split(a, len(a) * len(b) // AT_ONCE + 1):
            i, j = np.nonzero(_near(low[some, None], high[some, None], low_b[b], high_b[b], reach))
            found.append(some[i] * len(around) + b[j])
    numbers = np.unique(np.concatenate(found)) if found else np.zeros(0, int)
    return np.column_stack(np.divmod(numbers, max(len(around), 1)))


def _boxes(shapes: ConvexSet) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners (S, 3) of the boxes round shapes."""
    if not len(shapes):
        return np.zeros((0, 3)), np.zeros((0, 3))
    low, high = (f.reduceat(shapes.vertices, shapes.start[:-1]) for f in (np.minimum, np.maximum))
    return low - shapes.radius[:, None], high + shapes.radius[:, None]


def _near(low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray, reach: float) -> np.ndarray:
    """Whether boxes (..., 3) come nearer to each other than ``reach`` along every axis; arguments are broadcast."""
    return ((low_b - high_a <= reach) & (low_a - high_b <= reach)).all(axis=-1)
