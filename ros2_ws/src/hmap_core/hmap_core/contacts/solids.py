"""Shapes as exact solids for ray casting: a line through a convex shape is inside it on one interval."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import hull_vertices
from hmap_core.transforms import IDENTITY, rotation_matrix
from hmap_core.types import Shape, ShapeKind

_BOX, _CYLINDER, _SPHERE, _CAPSULE, _POLYTOPE = range(5)
_CODES = {
    ShapeKind.BOX: _BOX,
    ShapeKind.CYLINDER: _CYLINDER,
    ShapeKind.SPHERE: _SPHERE,
    ShapeKind.CAPSULE: _CAPSULE,
    ShapeKind.MESH: _POLYTOPE,
}
_PARALLEL = 1e-12
# solids with a smaller gap along a ray are connected, m
JOINED = 1e-6


@dataclass(frozen=True)
class Solids:
    """S convex solids in one frame.

    Attributes:
        kind: (S,) code of the shape.
        R: (S, 3, 3) orientation of each shape's own frame.
        p: (S, 3) its position, m.
        size: (S, 3) as in Shape, zero-padded.
        planes: (P, 4) faces n.x <= d of the polytopes, in their own frames.
        start: (S + 1,) shape s has the planes ``start[s]:start[s + 1]``.
    """

    kind: np.ndarray
    R: np.ndarray
    p: np.ndarray
    size: np.ndarray
    planes: np.ndarray
    start: np.ndarray

    @property
    def arrays(self) -> tuple:
        """The arguments of the compiled functions."""
        return self.kind, self.R, self.p, self.size, self.planes, self.start

    def __len__(self) -> int:
        return len(self.kind)


def _faces(shape: Shape) -> np.ndarray:
    """Planes (n, 4) of a mesh's convex hull, body frame."""
    vertices, _ = hull_vertices(shape)
    equations = ConvexHull(vertices).equations
    return np.unique(np.round(np.c_[equations[:, :3], -equations[:, 3]], 12), axis=0)


def solids(posed: Sequence[tuple[Shape, np.ndarray]]) -> Solids:
    """Make the solids of (shape, T_frame_body (7,)) pairs, in ``frame``."""
    count = len(posed)
    size = np.zeros((count, 3))
    R, p = np.zeros((count, 3, 3)), np.zeros((count, 3))
    planes, start = [], [0]
    for k, (shape, T_frame_body) in enumerate(posed):
        mesh = shape.kind == ShapeKind.MESH
        R[k], p[k] = rotation_matrix(T_frame_body), T_frame_body[:3]
        if not mesh and shape.pose is not IDENTITY:  # a mesh's hull is already in the body frame
            p[k] += R[k] @ shape.pose[:3]
            R[k] = R[k] @ rotation_matrix(shape.pose)
        size[k, : len(shape.size)] = shape.size
        planes.append(_faces(shape) if mesh else np.zeros((0, 4)))
        start.append(start[-1] + len(planes[-1]))
    codes = np.array([_CODES[shape.kind] for shape, _ in posed], np.int64)
    return Solids(codes, R, p, size, np.concatenate([np.zeros((0, 4)), *planes]), np.array(start, np.int64))


@njit(cache=True, error_model="numpy", nogil=True)
def _slab(o, d, half, t):
    """Clip the interval t (2,) to |o + t d| <= half."""
    if abs(d) < _PARALLEL:
        if abs(o) > half:
            t[0], t[1] = 1.0, 0.0
        return
    a, b = (-half - o) / d, (half - o) / d
    t[0] = max(t[0], min(a, b))
    t[1] = min(t[1], max(a, b))


@njit(cache=True, error_model="numpy", nogil=True)
def _quadratic(a, b, c, t):
    """Clip t (2,) to a t^2 + 2 b t + c <= 0 with a >= 0."""
    if a < _PARALLEL:
        if c > 0.0:
            t[0], t[1] = 1.0, 0.0
        return
    disc = b * b - a * c
    if disc < 0.0:
        t[0], t[1] = 1.0, 0.0
        return
    root = np.sqrt(disc)
    t[0] = max(t[0], (-b - root) / a)
    t[1] = min(t[1], (-b + root) / a)


@njit(cache=True, error_model="numpy", nogil=True)
def interval(s, origin, direction, kind, R, p, size, planes, start, t):
    """The parameters t (2,) between which the line origin + t direction is inside solid s; empty: t[0] > t[1]."""
    o0, o1, o2 = origin[0] - p[s, 0], origin[1] - p[s, 1], origin[2] - p[s, 2]
    r = R[s]
    x, y, z = (
        r[0, 0] * o0 + r[1, 0] * o1 + r[2, 0] * o2,
        r[0, 1] * o0 + r[1, 1] * o1 + r[2, 1] * o2,
        r[0, 2] * o0 + r[1, 2] * o1 + r[2, 2] * o2,
    )
    u, v, w = (
        r[0, 0] * direction[0] + r[1, 0] * direction[1] + r[2, 0] * direction[2],
        r[0, 1] * direction[0] + r[1, 1] * direction[1] + r[2, 1] * direction[2],
        r[0, 2] * direction[0] + r[1, 2] * direction[1] + r[2, 2] * direction[2],
    )
    t[0], t[1] = -np.inf, np.inf
    code = kind[s]
    a, b, c = size[s, 0], size[s, 1], size[s, 2]
    if code == _BOX:
        _slab(x, u, 0.5 * a, t)
        _slab(y, v, 0.5 * b, t)
        _slab(z, w, 0.5 * c, t)
    elif code == _CYLINDER:
        _quadratic(u * u + v * v, x * u + y * v, x * x + y * y - a * a, t)
        _slab(z, w, 0.5 * b, t)
    elif code == _SPHERE:
        _quadratic(u * u + v * v + w * w, x * u + y * v + z * w, x * x + y * y + z * z - a * a, t)
    elif code == _CAPSULE:
        # a convex union: its interval is the hull of those of the cylinder and of the two spheres
        _quadratic(u * u + v * v, x * u + y * v, x * x + y * y - a * a, t)
        _slab(z, w, 0.5 * b, t)
        ball = np.empty(2)
        for sign in (-1.0, 1.0):
            h = z - sign * 0.5 * b
            ball[0], ball[1] = -np.inf, np.inf
            _quadratic(u * u + v * v + w * w, x * u + y * v + h * w, x * x + y * y + h * h - a * a, ball)
            if ball[0] <= ball[1]:
                if t[0] > t[1]:
                    t[0], t[1] = ball[0], ball[1]
                else:
                    t[0], t[1] = min(t[0], ball[0]), max(t[1], ball[1])
    else:
        for k in range(start[s], start[s + 1]):
            speed = planes[k, 0] * u + planes[k, 1] * v + planes[k, 2] * w
            gap = planes[k, 3] - (planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z)
            if abs(speed) < _PARALLEL:
                if gap < 0.0:
                    t[0], t[1] = 1.0, 0.0
                    return
            elif speed > 0.0:
                t[1] = min(t[1], gap / speed)
            else:
                t[0] = max(t[0], gap / speed)


@njit(cache=True, error_model="numpy", nogil=True)
def way_out(origin, direction, kind, R, p, size, planes, start):
    """Distance from a point of the solids' surface through connected material to the far side, and the solid there.

    The ray can start JOINED outside the material. Returns (0, -1) if there is no material ahead.
    """
    t = np.empty(2)
    reach, last = 0.0, -1
    grew = True
    while grew:
        grew = False
        for s in range(kind.shape[0]):
            interval(s, origin, direction, kind, R, p, size, planes, start, t)
            if t[0] <= t[1] and t[0] <= reach + JOINED and t[1] > reach + JOINED:
                reach, last = t[1], s
                grew = True
    return reach, last


@njit(cache=True, error_model="numpy", nogil=True)
def covered(point, kind, R, p, size, planes, start):
    """Whether a point is inside one of the solids."""
    t = np.empty(2)
    up = np.array([0.0, 0.0, 1.0])
    for s in range(kind.shape[0]):
        interval(s, point, up, kind, R, p, size, planes, start, t)
        if t[0] <= t[1] and t[0] < 0.0 < t[1]:
            return True
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def outward_normal(s, point, kind, R, p, size, planes, start):
    """Outward unit normal (3,) of solid s at a point of its surface."""
    local = R[s].T @ (point - p[s])
    n = np.zeros(3)
    code = kind[s]
    if code == _BOX:
        face = np.argmax(np.abs(local) - 0.5 * size[s])
        n[face] = np.sign(local[face])
    elif code == _CYLINDER:
        rim = np.sqrt(local[0] ** 2 + local[1] ** 2)
        if abs(local[2]) - 0.5 * size[s, 1] > rim - size[s, 0]:
            n[2] = np.sign(local[2])
        else:
            n[0], n[1] = local[0] / rim, local[1] / rim
    elif code == _SPHERE or code == _CAPSULE:
        n[:] = local
        if code == _CAPSULE:
            half = 0.5 * size[s, 1]
            n[2] -= min(max(local[2], -half), half)
        n /= np.sqrt(n @ n)
    else:
        best = -np.inf
        for k in range(start[s], start[s + 1]):
            gap = planes[k, 0] * local[0] + planes[k, 1] * local[1] + planes[k, 2] * local[2] - planes[k, 3]
            if gap > best:
                best = gap
                n[:] = planes[k, :3]
    return R[s] @ n
