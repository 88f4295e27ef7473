"""Fewer vertices for a hull, never less volume: an inner hull swept by the small sphere that it lacks."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.gjk import signed_distance


def simplify_hull(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Vertices (m, 3) and a radius whose swept hull contains the hull of points (n, 3).

    Greedy: the vertex that sticks out of the present inner hull the most is added until none is more than ``tolerance``
    (m) beyond any of its planes. The radius is then the exact distance of the farthest point left out, so the result is
    nowhere more than that radius outside of the true hull.
    """
    try:
        points = points[ConvexHull(points).vertices]
    except QhullError:
        return points, 0.0
    chosen = {int(points[:, axis].argmin()) for axis in range(3)} | {int(points[:, axis].argmax()) for axis in range(3)}
    centroid_distance = np.linalg.norm(points - points.mean(0), axis=1)
    for index in np.argsort(-centroid_distance):
        if len(chosen) >= 4 and np.linalg.matrix_rank(points[sorted(chosen)] - points[min(chosen)], tol=1e-6) == 3:
            break
        chosen.add(int(index))
    while len(chosen) < len(points):
        hull = ConvexHull(points[sorted(chosen)])
        outside = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
        worst = int(outside.argmax())
        if outside[worst] <= tolerance:
            return points[sorted(chosen)], float(_outside_distance(points, points[sorted(chosen)]))
        chosen.add(worst)
    return points, 0.0


def _outside_distance(points: np.ndarray, inner: np.ndarray) -> float:
    """Largest distance in metres of points (n, 3) from the hull of inner (m, 3)."""
    witness, eye, origin = np.zeros((3, 3)), np.eye(3), np.zeros(3)
    inner = np.ascontiguousarray(inner)
    return max(
        max(0.0, signed_distance(p[None].copy(), eye, origin, 0.0, inner, eye, origin, 0.0, witness)) for p in points
    )
