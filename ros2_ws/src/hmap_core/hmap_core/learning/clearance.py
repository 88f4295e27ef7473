"""How far points are from what stands around: every shape by its box, compiled."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.convex import hull_vertices
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import Body, Shape, ShapeKind


@dataclass(frozen=True)
class Boxes:
    """S boxes in the world frame.

    Attributes:
        R: (S, 3, 3) orientations.
        p: (S, 3) centres, m.
        half: (S, 3) half extents, m.
    """

    R: np.ndarray
    p: np.ndarray
    half: np.ndarray

    @staticmethod
    def around(bodies: Iterable[tuple[Body, np.ndarray]]) -> "Boxes":
        """The boxes of bodies at poses T_world_body (7,)."""
        R, p, half = [], [], []
        for body, T in bodies:
            for shape in body.shapes:
                axes, middle, extent = _box(shape)
                R.append(rotation_matrix(T) @ axes)
                p.append(apply(T, middle))
                half.append(extent)
        if not R:
            return Boxes(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
        return Boxes(np.array(R), np.array(p), np.array(half))

    def near(self, lower: np.ndarray, upper: np.ndarray) -> "Boxes":
        """Those that may overlap an axis-aligned box from ``lower`` (3,) to ``upper`` (3,)."""
        if not len(self.p):
            return self
        reach = np.einsum("sij,sj->si", np.abs(self.R), self.half)
        keep = np.all((self.p - reach <= upper) & (self.p + reach >= lower), axis=1)
        return Boxes(self.R[keep], self.p[keep], self.half[keep])

    def distances(self, points: np.ndarray, limit: float) -> np.ndarray:
        """Distance (N,) of points (N, 3) from the nearest box, m: negative inside, at most ``limit``."""
        return box_distances(np.ascontiguousarray(points), self.R, self.p, self.half, limit)


def _box(shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes (3, 3), centre (3,) and half extents (3,) of a shape's box, body frame."""
    if shape.kind == ShapeKind.MESH:
        points, radius = hull_vertices(shape)
        lower, upper = points.min(axis=0) - radius, points.max(axis=0) + radius
        return np.eye(3), 0.5 * (lower + upper), 0.5 * (upper - lower)
    size = shape.size
    if shape.kind == ShapeKind.BOX:
        half = 0.5 * np.array(size)
    elif shape.kind == ShapeKind.SPHERE:
        half = np.full(3, size[0])
    else:
        end = size[0] if shape.kind == ShapeKind.CAPSULE else 0.0
        half = np.array([size[0], size[0], 0.5 * size[1] + end])
    return rotation_matrix(shape.pose), shape.pose[:3], half


@njit(**OPTIONS)
def _distance(x, y, z, R, p, half, limit):
    """Distance of one point from the nearest of S boxes, at most ``limit``; negative inside."""
    best = limit
    for s in range(p.shape[0]):
        dx, dy, dz = x - p[s, 0], y - p[s, 1], z - p[s, 2]
        a = abs(R[s, 0, 0] * dx + R[s, 1, 0] * dy + R[s, 2, 0] * dz) - half[s, 0]
        if a >= best:
            continue
        b = abs(R[s, 0, 1] * dx + R[s, 1, 1] * dy + R[s, 2, 1] * dz) - half[s, 1]
        if b >= best:
            continue
        c = abs(R[s, 0, 2] * dx + R[s, 1, 2] * dy + R[s, 2, 2] * dz) - half[s, 2]
        if c >= best:
            continue
        inside = max(a, b, c)
        if inside <= 0.0:
            best = min(best, inside)
        else:
            a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
            best = min(best, np.sqrt(a * a + b * b + c * c))
    return best


@njit(**OPTIONS)
def box_distances(points, R, p, half, limit):
    """Distance (N,) of points (N, 3) from the nearest of S boxes, at most ``limit``; negative inside."""
    out = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        out[n] = _distance(points[n, 0], points[n, 1], points[n, 2], R, p, half, limit)
    return out


@njit(**OPTIONS)
def probe_distances(frames, origins, probes, ways, R_stops, p_stops, back, R, p, half, limit):
    """Distances (K, T, Q) of the probes of K hands from the nearest of S boxes, at T stops of the object.

    Args:
        frames, origins: (K, 3, 3), (K, 3) of the hands, object frame.
        probes: (K, Q, 3) points of each hand, in its own frame.
        ways: (K, 3) from which each hand comes, object frame.
        R_stops, p_stops: (T, 3, 3), (T, 3) poses of the object.
        back: (T,) share of its way by which a hand is drawn back at a stop.
        R, p, half: the boxes.
        limit: largest distance.
    """
    K, Q, T = probes.shape[0], probes.shape[1], p_stops.shape[0]
    out = np.full((K, T, Q), limit)
    for k in range(K):
        F, o, n = frames[k], origins[k], probes[k]
        for q in range(Q):
            u0 = o[0] + F[0, 0] * n[q, 0] + F[0, 1] * n[q, 1] + F[0, 2] * n[q, 2]
            v0 = o[1] + F[1, 0] * n[q, 0] + F[1, 1] * n[q, 1] + F[1, 2] * n[q, 2]
            w0 = o[2] + F[2, 0] * n[q, 0] + F[2, 1] * n[q, 1] + F[2, 2] * n[q, 2]
            for t in range(T):
                u, v, w = u0 - back[t] * ways[k, 0], v0 - back[t] * ways[k, 1], w0 - back[t] * ways[k, 2]
                x = p_stops[t, 0] + R_stops[t, 0, 0] * u + R_stops[t, 0, 1] * v + R_stops[t, 0, 2] * w
                y = p_stops[t, 1] + R_stops[t, 1, 0] * u + R_stops[t, 1, 1] * v + R_stops[t, 1, 2] * w
                z = p_stops[t, 2] + R_stops[t, 2, 0] * u + R_stops[t, 2, 1] * v + R_stops[t, 2, 2] * w
                out[k, t, q] = _distance(x, y, z, R, p, half, limit)
    return out
