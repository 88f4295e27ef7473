"""A proof that a body has no planar path: the obstacles separate start and goal for a disc inside the body."""

import numpy as np
import scipy
from scipy.spatial import ConvexHull, QhullError

from hmap_core.transforms import rotation_matrix
from hmap_core.waypoints.checker import PENETRATION_ALLOWED, ObjectChecker

CELL = 0.01  # m
MAX_CELLS = 400_000  # larger grids get larger cells
# reduction of the disc's radius for rounding errors, m
SLACK = 1e-4
# diagonal neighbours count as connected, which is conservative
_CONNECTED = np.ones((3, 3), bool)
# planes that are closer to horizontal do not bound the disc
_LEVEL = 1e-9


def separated(checker: ObjectChecker, start: np.ndarray, goal: np.ndarray, bounds: np.ndarray) -> bool:
    """Whether planar motion provably leads from no pose near ``start`` to none near ``goal``.

    A level disc around the body's origin moves with the body. A grid cell is closed if the disc would penetrate an
    obstacle too deeply at every position in the cell. If the open cells do not connect start and goal, no path exists.

    Args:
        checker: the body and its obstacles, for planar motion.
        start: T_world_obj (7,).
        goal: T_world_obj (7,).
        bounds: (2, 3) lower and upper position, m.

    Returns:
        True if no path exists within the bounds; False if the method does not decide.
    """
    radius = inner_radius(checker, start)
    extent = bounds[1, :2] - bounds[0, :2]
    cell = max(CELL, float(np.sqrt(np.prod(extent) / MAX_CELLS)))
    reach = radius - PENETRATION_ALLOWED - SLACK - cell * np.sqrt(0.5)
    if reach <= 0.0:
        return False
    shape = np.ceil(extent / cell).astype(int) + 1
    closed = np.zeros(shape, bool)
    for hull, swept in checker.obstacles.hulls:
        if checker.late:
            return False
        for half in _section(hull, float(start[2])):
            _close(closed, half, reach + swept, bounds[0, :2], cell)
    ends = [tuple(np.clip(np.round((T[:2] - bounds[0, :2]) / cell).astype(int), 0, shape - 1)) for T in (start, goal)]
    if closed[ends[0]] or closed[ends[1]]:
        return False
    region, _ = scipy.ndimage.label(~closed, structure=_CONNECTED)
    return bool(region[ends[0]] != region[ends[1]])


def inner_radius(checker: ObjectChecker, T: np.ndarray) -> float:
    """Radius in m of a level disc around the body's origin inside one of its shapes at pose T (7,); 0 without one.

    Shapes that come after the deadline are left out.
    """
    R = rotation_matrix(T)
    best = 0.0
    for k in range(len(checker.body)):
        hull = checker.body.hull(k)
        if np.any(hull.min(axis=0) >= 0.0) or np.any(hull.max(axis=0) <= 0.0):
            continue  # it does not contain the origin
        if checker.late:
            break
        try:
            planes = ConvexHull(hull @ R.T).equations
        except (QhullError, ValueError):
            continue
        level = np.linalg.norm(planes[:, :2], axis=1)
        if planes[:, 3].max() < 0.0:
            side = level > _LEVEL
            best = max(best, float((-planes[side, 3] / level[side]).min()))
    return best


def _section(hull: np.ndarray, z: float) -> list[np.ndarray]:
    """The polygon (n, 2), counter-clockwise, where the plane at height z cuts a convex hull (n, 3); or none."""
    below, above = hull[hull[:, 2] < z], hull[hull[:, 2] >= z]
    if not len(below) or not len(above):
        return []
    share = (z - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
    points = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
    try:
        points = points.reshape(-1, 2)
        return [points[ConvexHull(points).vertices]]
    except (QhullError, ValueError):
        return []


def _close(closed: np.ndarray, polygon: np.ndarray, reach: float, origin: np.ndarray, cell: float) -> None:
    """Close the cells whose centres are within ``reach`` of a convex polygon (n, 2)."""
    low = np.clip(np.floor((polygon.min(0) - reach - origin) / cell).astype(int), 0, closed.shape)
    high = np.clip(np.ceil((polygon.max(0) + reach - origin) / cell).astype(int) + 1, 0, closed.shape)
    if np.any(high <= low):
        return
    x = origin[0] + cell * np.arange(low[0], high[0])
    y = origin[1] + cell * np.arange(low[1], high[1])
    inside = np.ones((len(x), len(y)), bool)
    near = np.zeros_like(inside)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        edge = b - a
        dx, dy = x[:, None] - a[0], y[None, :] - a[1]
        inside &= edge[0] * dy - edge[1] * dx >= 0.0
        along = np.clip((edge[0] * dx + edge[1] * dy) / (edge @ edge), 0.0, 1.0)
        near |= (dx - along * edge[0]) ** 2 + (dy - along * edge[1]) ** 2 <= reach**2
    closed[low[0] : high[0], low[1] : high[1]] |= inside | near
