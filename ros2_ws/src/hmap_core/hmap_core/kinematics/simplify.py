"""Reduces the number of vertices of a convex hull without losing volume, by an inner hull swept by a small sphere."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.array_cache import kept_arrays
from hmap_core.collision.gjk import signed_distance


def simplify_hull(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Approximates a convex hull from outside by a swept hull with fewer vertices.

    The algorithm is greedy: it adds the vertex that is farthest outside the current inner hull until no vertex is more
    than ``tolerance`` beyond any face. The radius is the exact distance of the farthest omitted vertex, so the result
    exceeds the true hull by at most the radius.

    Args:
        points: (n, 3), m.
        tolerance: m.

    Returns:
        Vertices (m, 3) and the radius of the sweeping sphere, m; the points and 0 if they span no volume.
    """
    inputs = points.tobytes(), np.float64(tolerance).tobytes()
    vertices, radius = kept_arrays(__file__, inputs, ("numpy", "scipy"), lambda: _simplified(points, tolerance))
    return vertices, float(radius)


def _simplified(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    try:
        points = points[ConvexHull(points).vertices]
    except QhullError:
        return points, np.zeros(())
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
            return points[sorted(chosen)], np.array(_outside_distance(points, points[sorted(chosen)]))
        chosen.add(worst)
    return points, np.zeros(())


def _outside_distance(points: np.ndarray, inner: np.ndarray) -> float:
    """Largest distance of points (n, 3) from the hull of ``inner`` (m, 3), m."""
    witness, eye, origin = np.zeros((3, 3)), np.eye(3), np.zeros(3)
    inner = np.ascontiguousarray(inner)
    return max(
        max(0.0, signed_distance(p[None].copy(), eye, origin, 0.0, inner, eye, origin, 0.0, witness)) for p in points
    )
