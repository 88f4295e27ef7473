"""Edges of convex hulls, along which the farthest vertex in a direction is found by climbing."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

CLIMB_FROM = 16  # vertices; on smaller hulls looking at every vertex is as fast
NO_EDGES = np.zeros(0, np.int32)


def hull_edges(points: np.ndarray) -> np.ndarray:
    """Neighbours of each vertex of the hull of points (n, 3), all of which are its vertices.

    Returns:
        (n + 1 + 2 E,) int32: the neighbours of vertex i are ``edges[edges[i]:edges[i + 1]]``; empty for small or flat
        hulls. A vertex that no neighbour exceeds is the farthest, since the hull is convex.
    """
    n = len(points)
    if n < CLIMB_FROM:
        return NO_EDGES
    try:
        hull = ConvexHull(points)
    except QhullError:
        return NO_EDGES
    if len(hull.vertices) < n:  # some vertex lies within: it would have no neighbours
        return NO_EDGES
    near = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]])
    near = np.unique(np.concatenate([near, near[:, ::-1]]), axis=0)
    first = n + 1 + np.searchsorted(near[:, 0], np.arange(n + 1))
    return np.concatenate([first, near[:, 1]]).astype(np.int32)
