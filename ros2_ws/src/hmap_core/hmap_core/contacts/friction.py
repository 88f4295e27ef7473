"""Quasi-static pushing in the plane: pushes that a sliding object follows without slipping off the pusher.

The friction between the object and its support is modelled as an ellipsoidal limit surface: to slide with the twist
(vx, vy, w) about the centre of friction, the object needs a force (fx, fy) and a moment m in the direction
(vx, vy, c^2 w), where c = m_max / f_max (Howe & Cutkosky, IJRR 1996). A line contact sticks if that wrench is inside
the cone spanned by the edges of the friction cones at its two ends: the stable push (Lynch & Mason, IJRR 1996).
"""

import numpy as np
from numba import njit

# the contact area of each foot is integrated over a grid of GRID x GRID points
GRID = 24
# tolerance for rounding of the weights of unit forces
_ROUNDING = 1e-9
# generators that span less than this (unit forces, moments in m) are degenerate
_SINGULAR = 1e-9


def characteristic_length(polygons: list[np.ndarray], centre: np.ndarray) -> float:
    """c = m_max / f_max in m for uniform pressure: the mean distance of the footprint from ``centre`` (2,).

    Args:
        polygons: convex and counter-clockwise, (n, 2) each, m; overlaps count once.
        centre: (2,) centre of friction, m.
    """
    u = (np.arange(GRID) + 0.5) / GRID
    unit = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    weighted, total = 0.0, 0.0
    for k, polygon in enumerate(polygons):
        lower, size = polygon.min(axis=0), np.ptp(polygon, axis=0)
        grid = lower + unit * size
        grid = grid[_inside(grid, polygon)]
        for earlier in polygons[:k]:
            grid = grid[~_inside(grid, earlier)]
        cell = size[0] * size[1]
        weighted += cell * np.linalg.norm(grid - centre, axis=1).sum()
        total += cell * len(grid)
    return float(weighted / total)


def _inside(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Whether points (N, 2) are inside a convex counter-clockwise polygon (n, 2)."""
    before = np.roll(polygon, 1, axis=0)
    edge, away = polygon - before, points[:, None] - before
    return np.all(edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0] >= 0.0, axis=1)


def needed_wrench(twist: np.ndarray, length: float) -> np.ndarray:
    """Direction (..., 3) of the wrench (fx, fy, m) about the centre of friction for a twist (vx, vy, w)."""
    return np.asarray(twist, float) * [1.0, 1.0, length**2]


def cone_generators(ends: np.ndarray, normals: np.ndarray, friction: float) -> np.ndarray:
    """The edges of the friction cones at both ends of line contacts, as wrenches about the centre of friction.

    Args:
        ends: (N, 2, 2) positions relative to the centre, m.
        normals: (N, 2) outward unit normals of the pushed object's side.
        friction: coefficient between pusher and object.

    Returns:
        (N, 4, 3) unit forces and their moments.
    """
    inward = -normals
    tangent = np.stack([-inward[:, 1], inward[:, 0]], axis=1)
    forces = np.stack([inward + friction * tangent, inward - friction * tangent], axis=1)  # (N, 2, 2)
    forces = forces / np.linalg.norm(forces, axis=2, keepdims=True)
    r, f = ends[:, :, None, :], forces[:, None, :, :]
    moment = r[..., 0] * f[..., 1] - r[..., 1] * f[..., 0]
    f = np.broadcast_to(f, moment.shape + (2,))
    return np.concatenate([f, moment[..., None]], axis=3).reshape(len(ends), 4, 3)


@njit(cache=True, error_model="numpy", nogil=True)
def _det(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])


@njit(cache=True, error_model="numpy", nogil=True)
def in_cone(generators, wrench):
    """Whether ``wrench`` (3,) is a non-negative combination of each set of generators (N, 4, 3): (N,) bool.

    By Caratheodory's theorem three of the four are sufficient; their weights follow from Cramer's rule.
    """
    inside = np.zeros(generators.shape[0], np.bool_)
    for n in range(generators.shape[0]):
        g = generators[n]
        for skip in range(4):
            a, b, c = g[0 if skip != 0 else 3], g[1 if skip != 1 else 3], g[2 if skip != 2 else 3]
            whole = _det(a, b, c)
            if abs(whole) < _SINGULAR:
                continue
            least = min(_det(wrench, b, c) / whole, _det(a, wrench, c) / whole, _det(a, b, wrench) / whole)
            if least >= -_ROUNDING:
                inside[n] = True
                break
    return inside


def stable_pushes(
    ends: np.ndarray, normals: np.ndarray, friction: float, twists: np.ndarray, length: float
) -> np.ndarray:
    """Test for stable pushes.

    Args:
        ends: (N, 2, 2) ends of the line contacts relative to the centre of friction, m.
        normals: (N, 2) outward unit normals of the pushed object's side.
        friction: coefficient between pusher and object.
        twists: (T, 3) motions of the object, vx, vy, w.
        length: characteristic length of the limit surface, m.

    Returns:
        (N,) whether the contact sticks during all twists.
    """
    generators = cone_generators(ends, normals, friction)
    good = np.ones(len(ends), bool)
    for twist in twists:
        wrench = needed_wrench(twist, length)
        size = np.linalg.norm(wrench)
        good &= in_cone(generators, wrench / size) if size > 0.0 else False
    return good
