"""The body behind the points that a camera sees of an unknown thing: a sphere where it looks like one, else a box."""

import numpy as np

from hmap_core import transforms
from hmap_core.types import Body, BodyKind, Shape, ShapeKind

MIN_POINTS = 20  # fewer are no thing
MAX_POINTS = 4000  # more are thinned
SPHERE_RESIDUAL = 0.002  # m, root mean square of the points' distances from the sphere
SPHERE_RADII = (0.005, 0.25)  # m, that are believed
MIN_DISTANCE = 0.002  # m by which shapes are made larger than what was seen
YAWS = 90  # turns of a box about the vertical that are tried
ROUNDS = 10  # of following a sphere
OUTLIERS = 1.0  # per cent of the points at each side that count as noise


def estimate_body(name: str, points: np.ndarray, floor: float = -np.inf) -> Body | None:
    """A fixed body that holds what was seen; None where too little was.

    Args:
        points: (N, 3) on its surface, world frame, m.
        floor: height (m) of what it could stand on. What is hidden below what was seen of a box counts as filled down
            to there.
    """
    points = np.asarray(points, float)
    if len(points) < MIN_POINTS:
        return None
    points = points[:: max(1, len(points) // MAX_POINTS)]
    ball = _sphere(points)
    shape, T = ball if ball is not None else _box(points, floor)
    return Body(name, BodyKind.FIXED, (shape,), T)


def follow_body(body: Body, points: np.ndarray, eye: np.ndarray) -> Body | None:
    """A sphere that was estimated before, where new points have it; None for other shapes, or where they do not fit it.

    Less of it needs to be seen than for a new estimate, since its size is known.

    Args:
        points: (N, 3) on its surface, world frame, m.
        eye: (3,) from where they were seen.
    """
    points = np.asarray(points, float)
    (shape,) = body.shapes
    if shape.kind is not ShapeKind.SPHERE or len(points) < MIN_POINTS:
        return None
    radius = shape.size[0] - MIN_DISTANCE
    middle = points.mean(axis=0)
    center = middle + radius * (middle - eye) / np.linalg.norm(middle - eye)  # behind what is seen
    for _ in range(ROUNDS):  # Gauss-Newton on the distances from the surface
        way = points - center
        length = np.linalg.norm(way, axis=1)
        step = np.linalg.lstsq(way / length[:, None], length - radius, rcond=None)[0]
        center = center + step
    off = np.linalg.norm(points - center, axis=1) - radius
    if np.sqrt(np.mean(off**2)) > SPHERE_RESIDUAL:
        return None
    return Body(body.name, BodyKind.FIXED, (shape,), transforms.pose(center))


def _sphere(points: np.ndarray) -> tuple[Shape, np.ndarray] | None:
    """The sphere through the points by linear least squares: p.p = 2 c.p + (r^2 - c.c)."""
    middle = points.mean(axis=0)
    p = points - middle
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2.0 * p, np.ones(len(p))], (p**2).sum(axis=1), rcond=None)
    square = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or square <= 0.0:
        return None
    radius = float(np.sqrt(square))
    off = np.linalg.norm(p - solution[:3], axis=1) - radius
    if np.sqrt(np.mean(off**2)) > SPHERE_RESIDUAL or not SPHERE_RADII[0] <= radius <= SPHERE_RADII[1]:
        return None
    if np.ptp(points, axis=0).max() < radius:  # a small patch of nearly flat surface fits many spheres
        return None
    return Shape(ShapeKind.SPHERE, (radius + MIN_DISTANCE,)), transforms.pose(middle + solution[:3])


def _box(points: np.ndarray, floor: float) -> tuple[Shape, np.ndarray]:
    """The upright box of least area round the points."""
    low, high = np.percentile(points[:, 2], [OUTLIERS, 100.0 - OUTLIERS])
    low = floor if np.isfinite(floor) and floor < high else low
    best = None
    for yaw in np.arange(YAWS) * (np.pi / 2.0 / YAWS):
        c, s = np.cos(yaw), np.sin(yaw)
        across = points[:, :2] @ np.array([[c, -s], [s, c]])
        a, b = np.percentile(across, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
        if best is None or np.prod(b - a) < best[0]:
            best = np.prod(b - a), yaw, a, b
    _, yaw, a, b = best
    c, s = np.cos(yaw), np.sin(yaw)
    middle = np.array([[c, -s], [s, c]]) @ (0.5 * (a + b))
    size = np.array([*(b - a), high - low]) + 2.0 * MIN_DISTANCE
    T = transforms.from_rpy((*middle, 0.5 * (low + high)), (0.0, 0.0, yaw))
    return Shape(ShapeKind.BOX, tuple(size.tolist())), T
