"""The shape of an unknown body from the points that a camera sees: a sphere if the points fit one, otherwise a box."""

import numpy as np

from hmap_core import transforms
from hmap_core.types import Body, BodyKind, Shape, ShapeKind

MIN_POINTS = 20  # fewer are no body
MAX_POINTS = 4000  # more are down-sampled
SPHERE_RESIDUAL = 0.002  # m, root mean square of the points' distances from the sphere
SPHERE_RADII = (0.005, 0.25)  # m, plausible radii
MIN_DISTANCE = 0.002  # m by which shapes are larger than the visible points
YAWS = 90  # number of yaw angles of a box that are tried
ROUNDS = 10  # iterations of tracking a sphere
OUTLIERS = 1.0  # percentage of the points at each side that count as noise


def estimate_body(name: str, points: np.ndarray, floor: float = -np.inf) -> Body | None:
    """Estimate a fixed body that contains the visible points.

    Args:
        name: name of the body.
        points: (N, 3) on its surface, world frame, m.
        floor: height in m of the surface that the body could stand on. A box extends down to there, because its lower
            part can be hidden.

    Returns:
        The body, or None with fewer than MIN_POINTS points.
    """
    points = np.asarray(points, float)
    if len(points) < MIN_POINTS:
        return None
    points = points[:: max(1, len(points) // MAX_POINTS)]
    ball = _sphere(points)
    shape, T = ball if ball is not None else _box(points, floor)
    return Body(name, BodyKind.FIXED, (shape,), T)


def track_body(body: Body, points: np.ndarray, eye: np.ndarray) -> Body | None:
    """Update the position of an estimated sphere from new points.

    The sphere's size is known, so fewer visible points suffice than for a new estimate.

    Args:
        body: a body from :func:`estimate_body`.
        points: (N, 3) on its surface, world frame, m.
        eye: (3,) position of the camera, world frame, m.

    Returns:
        The sphere at its new position; None for other shapes, or if the points do not fit.
    """
    points = np.asarray(points, float)
    (shape,) = body.shapes
    if shape.kind is not ShapeKind.SPHERE or len(points) < MIN_POINTS:
        return None
    radius = shape.size[0] - MIN_DISTANCE
    middle = points.mean(axis=0)
    center = middle + radius * (middle - eye) / np.linalg.norm(middle - eye)  # behind the visible points
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
    """The upright box with the smallest base area around the points."""
    low, high = np.percentile(points[:, 2], [OUTLIERS, 100.0 - OUTLIERS])
    low = floor if np.isfinite(floor) and floor < high else low
    found = []
    for yaw in np.arange(YAWS) * (np.pi / 2.0 / YAWS):
        c, s = np.cos(yaw), np.sin(yaw)
        across = points[:, :2] @ np.array([[c, -s], [s, c]])
        a, b = np.percentile(across, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
        found.append((yaw, a, b))
    yaw, a, b = min(found, key=lambda base: float(np.prod(base[2] - base[1])))
    c, s = np.cos(yaw), np.sin(yaw)
    middle = np.array([[c, -s], [s, c]]) @ (0.5 * (a + b))
    size = np.array([*(b - a), high - low]) + 2.0 * MIN_DISTANCE
    T = transforms.from_rpy((*middle, 0.5 * (low + high)), (0.0, 0.0, yaw))
    return Shape(ShapeKind.BOX, tuple(size.tolist())), T
