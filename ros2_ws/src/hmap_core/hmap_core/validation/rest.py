"""Whether an object that lies in a cradle, leans, or could roll stays where it is.

Contact forces inside friction cones have to balance gravity. Gravity is tilted by ``limits.REST_TILT`` in turn in
``DIRECTIONS`` horizontal directions; for each, the object may first move by up to ``limits.ROLL_ROOM``, until something
stops it.
"""

from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.validation import limits
from hmap_core.validation.forces import balance
from hmap_core.validation.geometry import Solid, transform
from hmap_core.validation.world import Part, World

DIRECTIONS = 8
CONE_EDGES = 8  # edges of the pyramid in a friction cone
ROLL_STEPS = 16
FLAT = 1e-4  # m; vertices this near to the foremost one belong to the feature that touches
TINY = 1e-9
_ANGLES = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS


def stays(world: World, name: str, others: list[Part], center: np.ndarray, k: int) -> bool:
    """Whether a body stays within ``limits.ROLL_ROOM`` of its pose at sample k.

    Args:
        world: the plan.
        name: of the body.
        others: parts that are near and stand.
        center: (3,) its centre of mass, world frame.
        k: the sample.
    """
    parts = world.parts_of(name)
    return all(_stops(world, parts, others, center, k, np.array([np.cos(a), np.sin(a), 0.0])) for a in _ANGLES)


def _stops(world: World, own: list[Part], others: list[Part], center: np.ndarray, k: int, way: np.ndarray) -> bool:
    gravity = limits.REST_TILT * way - [0.0, 0.0, 1.0]
    known = 0  # wrenches at the last step; with as many, the body rolls on
    for step in np.linspace(0.0, limits.ROLL_ROOM, ROLL_STEPS):
        wrenches, lifts, deepest = _wrenches(world, own, others, center, k, step * way)
        if deepest < -2.0 * limits.PENETRATION and step > 0.0:
            return False
        if len(lifts) != known and _balanced(wrenches, lifts, gravity):
            return True
        known = len(lifts)
    return False


def _balanced(wrenches: np.ndarray, lifts: np.ndarray, gravity: np.ndarray) -> bool:
    """Whether a combination of wrenches (6, m) with positive factors balances gravity, which acts at the origin.

    ``lifts`` (m,) are the vertical parts of the normal forces; they carry ``limits.REST_CARRIED`` of the weight.
    """
    if not wrenches.size:
        return False
    scale = max(float(np.abs(wrenches[3:]).max()), TINY)
    more = np.zeros((7, 1))  # what the normal forces carry beyond their share
    more[6] = -1.0
    rows = np.hstack([np.vstack([wrenches[:3], wrenches[3:] / scale, lifts]), more])
    return balance(rows, np.r_[-gravity, 0.0, 0.0, 0.0, limits.REST_CARRIED])


def _wrenches(
    world: World, own: list[Part], others: list[Part], center: np.ndarray, k: int, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Wrenches (6, m) about the centre of mass that what stands around exerts on a moved body.

    Returns:
        The wrenches, the vertical parts (m,) of their normal forces, and the smallest distance in metres.
    """
    columns, lifts, deepest = [], [], np.inf
    for a, b in product(own, others):
        distance, points, normal = touch(world, a, b, k, offset)
        deepest = min(deepest, distance)
        if not len(points):
            continue
        friction = limits.REST_FRICTION * friction_of(world, a.holder, b.holder)
        for p, force in product(points - center - offset, cone(normal, friction)):
            columns.append(np.r_[force, np.cross(p, force)])
            lifts.append(normal[2])
    return np.array(columns).T if columns else np.zeros((6, 0)), np.array(lifts), deepest


def touch(
    world: World, a: Part, b: Part, k: int, offset: np.ndarray | float = 0.0
) -> tuple[float, np.ndarray, np.ndarray]:
    """Where a part touches another one at sample k, moved by an ``offset`` (3,) in m.

    Returns:
        Their distance in m, the corners (n, 3) of the patch, world frame, and the unit normal (3,) into the first part.
        No corners where they are farther apart than ``limits.SUPPORT_GAP``.
    """
    A, B = world.tracks[a], world.tracks[b]
    place = A.p[k] + offset
    distance, _, point, toward = world.gauge(a, b).witness(transform(A.R[k], place), B.at(k))
    if distance > limits.SUPPORT_GAP:
        return distance, np.zeros((0, 3)), -toward
    points = _touching(_feature(a.solid, A.R[k], place, toward), _feature(b.solid, B.R[k], B.p[k], -toward), toward)
    return distance, points if len(points) else point[None], -toward


def friction_of(world: World, *names: str) -> float:
    """The lowest friction coefficient of some bodies."""
    return min(world.document.bodies[name].friction for name in names)


def _feature(solid: Solid, R: np.ndarray, p: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The foremost vertices (n, 3) of a shape in a direction, on its surface."""
    points = solid.points @ R.T + p
    ahead = points @ direction
    return points[ahead >= ahead.max() - FLAT] + solid.ball * direction


def _touching(a: np.ndarray, b: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Points (n, 3) that span the common part of two features (n, 3), (m, 3) in the plane of their normal."""
    axes = np.linalg.svd(normal[None])[2][1:]
    origin = b.mean(axis=0)
    u, v = (a - origin) @ axes.T, (b - origin) @ axes.T
    found = [*u[_covered(v, u)], *v[_covered(u, v)]]
    found += [q for s, t in product(_sides(u), _sides(v)) for q in _crossing(*s, *t)]
    return origin + np.array(found).reshape(-1, 2) @ axes


def _sides(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The edges of the hull of points (n, 2)."""
    try:
        return [(points[i], points[j]) for i, j in ConvexHull(points).simplices]
    except (QhullError, ValueError):
        far = points[np.linalg.norm(points - points[0], axis=1).argmax()]
        return [(points[0], far)] if np.linalg.norm(far - points[0]) > TINY else []


def _covered(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which of some points (m, 2) the hull of points (n, 2) contains: (m,)."""
    try:
        equations = ConvexHull(points).equations
        return (others @ equations[:, :2].T + equations[:, 2]).max(axis=1) <= FLAT
    except (QhullError, ValueError):
        a = points[0]
        b = points[np.linalg.norm(points - a, axis=1).argmax()]
        length = float(np.linalg.norm(b - a))
        share = np.clip((others - a) @ (b - a) / length**2, 0.0, 1.0) if length > TINY else np.zeros(len(others))
        return np.linalg.norm(a + share[:, None] * (b - a) - others, axis=1) <= FLAT


def _crossing(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> list[np.ndarray]:
    """The point (2,) at which the segments ab and cd cross, if they do."""
    M = np.column_stack([b - a, c - d])
    if abs(np.linalg.det(M)) < TINY:
        return []
    s, t = np.linalg.solve(M, c - a)
    return [a + s * (b - a)] if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0 else []


def cone(normal: np.ndarray, friction: float) -> np.ndarray:
    """Edges (CONE_EDGES, 3) of a pyramid in the friction cone about a unit normal (3,)."""
    first, second = np.linalg.svd(normal[None])[2][1:]
    angles = 2.0 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES
    return normal + friction * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
