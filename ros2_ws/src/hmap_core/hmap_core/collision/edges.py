"""Edges of convex hulls, for support functions by hill climbing (Cameron 1997)."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

CLIMB_FROM = 16  # vertices; for smaller hulls, testing every vertex is as fast
NO_EDGES = np.zeros(0, np.int32)


def hull_edges(points: np.ndarray) -> np.ndarray:
    """Adjacent vertices of each vertex of a convex hull.

    Hill climbing along these edges finds the support vertex: a vertex without a better neighbour is optimal, since the
    hull is convex.

    Args:
        points: (n, 3), the vertices of the hull.

    Returns:
        (n + 1 + 2 E,) int32: the neighbours of vertex i are ``edges[edges[i]:edges[i + 1]]``. Empty for small or flat
        hulls, and if some point is not a vertex.
    """
    n = len(points)
    if n < CLIMB_FROM:
        return NO_EDGES
    try:
        hull = ConvexHull(points)
    except QhullError:
        return NO_EDGES
    if len(hull.vertices) < n:  # a point inside the hull has no neighbours
        return NO_EDGES
    near = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]])
    near = np.unique(np.concatenate([near, near[:, ::-1]]), axis=0)
    first = n + 1 + np.searchsorted(near[:, 0], np.arange(n + 1))
    return np.concatenate([first, near[:, 1]]).astype(np.int32)
