"""How far points are from what stands around: every shape by its box, compiled."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit

from hmap_core.collision.compile_options import OPTIONS, PLAIN
from hmap_core.collision.convex import hull_vertices
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import Body, Shape, ShapeKind

BLOCK = 32  # hands whose probes are compared with a box at once; their numbers fit into the cache


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


@njit(**PLAIN)
def _place(frames, origins, openings, probes, widening, ways, back, x, y, z):
    """Write the coordinates (K * Q,) of the probes of K hands, object frame; returns their largest distance from it."""
    Q, largest = probes.shape[0], 0.0
    for k in range(frames.shape[0]):
        F, width = frames[k], openings[k]
        u, v, w = (
            origins[k, 0] - back * ways[k, 0],
            origins[k, 1] - back * ways[k, 1],
            origins[k, 2] - back * ways[k, 2],
        )
        for q in range(Q):
            n0, n1 = probes[q, 0] + width * widening[q, 0], probes[q, 1] + width * widening[q, 1]
            n2 = probes[q, 2] + width * widening[q, 2]
            a = u + F[0, 0] * n0 + F[0, 1] * n1 + F[0, 2] * n2
            b = v + F[1, 0] * n0 + F[1, 1] * n1 + F[1, 2] * n2
            c = w + F[2, 0] * n0 + F[2, 1] * n1 + F[2, 2] * n2
            x[k * Q + q], y[k * Q + q], z[k * Q + q] = a, b, c
            square = a * a + b * b + c * c
            largest = square if square > largest else largest
    return np.sqrt(largest)


@njit(**PLAIN)
def _compare(x, y, z, M, shift, half, deepest, nearest):
    """Update, with one box, the least signed depth (N,) and the least squared distance (N,) of points (N,) each.

    There are no branches, and matrices are read into numbers first, so that the compiler uses vector instructions.
    """
    ax, ay, az, bx, by, bz = M[0, 0], M[0, 1], M[0, 2], M[1, 0], M[1, 1], M[1, 2]
    cx, cy, cz, a0, b0, c0 = M[2, 0], M[2, 1], M[2, 2], shift[0], shift[1], shift[2]
    a1, b1, c1 = half[0], half[1], half[2]
    for n in range(x.shape[0]):
        a = abs(ax * x[n] + ay * y[n] + az * z[n] + a0) - a1
        b = abs(bx * x[n] + by * y[n] + bz * z[n] + b0) - b1
        c = abs(cx * x[n] + cy * y[n] + cz * z[n] + c0) - c1
        depth = a if a > b else b
        depth = depth if depth > c else c
        a, b, c = a if a > 0.0 else 0.0, b if b > 0.0 else 0.0, c if c > 0.0 else 0.0
        square = a * a + b * b + c * c
        deepest[n] = depth if depth < deepest[n] else deepest[n]
        nearest[n] = square if square < nearest[n] else nearest[n]


@njit(**OPTIONS)
def probe_distances(
    frames, origins, openings, probes, widening, ways, R_stops, p_stops, back, R, p, half, limit, scale, out, column
):
    """Write the distances of Q probes of K hands from the nearest of S boxes, at T stops of the object.

    Args:
        frames, origins: (K, 3, 3), (K, 3) of the hands, object frame.
        openings: (K,) of the hands.
        probes: (Q, 3) points of closed hands, in their own frames.
        widening: (Q, 3) by which the probes move with the opening.
        ways: (K, 3) from which each hand comes, object frame.
        R_stops, p_stops: (T, 3, 3), (T, 3) poses of the object.
        back: (T,) share of its way by which a hand is drawn back at a stop.
        R, p, half: the boxes.
        limit: largest distance, above 0.
        scale: by which distances are multiplied.
        out: (K, ...) T * Q columns of it are written, the probes of the first stop first.
        column: the first of them.
    """
    K, Q, T = frames.shape[0], probes.shape[0], p_stops.shape[0]
    N = min(K, BLOCK) * Q
    x, y, z, deepest, nearest = np.empty(N), np.empty(N), np.empty(N), np.empty(N), np.empty(N)
    M, shift = np.empty((T, p.shape[0], 3, 3)), np.empty((T, p.shape[0], 3))  # from the object's frame to the boxes'
    for t in range(T):
        for s in range(p.shape[0]):
            for i in range(3):
                shift[t, s, i] = 0.0
                for j in range(3):
                    shift[t, s, i] += R[s, j, i] * (p_stops[t, j] - p[s, j])
                    M[t, s, i, j] = R[s, 0, i] * R_stops[t, 0, j] + R[s, 1, i] * R_stops[t, 1, j]
                    M[t, s, i, j] += R[s, 2, i] * R_stops[t, 2, j]
    for first in range(0, K, BLOCK):
        last, radius = min(first + BLOCK, K), 0.0
        own = slice(first, last)
        N = (last - first) * Q
        for t in range(T):
            if t == 0 or back[t] != back[t - 1]:
                radius = _place(frames[own], origins[own], openings[own], probes, widening, ways[own], back[t], x, y, z)
            deepest[:], nearest[:] = limit, limit * limit
            for s in range(p.shape[0]):
                c, h = shift[t, s], half[s]
                far = max(abs(c[0]) - h[0], abs(c[1]) - h[1], abs(c[2]) - h[2])
                if far < limit + radius:
                    _compare(x[:N], y[:N], z[:N], M[t, s], c, h, deepest, nearest)
            for k in range(last - first):
                for q in range(Q):
                    n = k * Q + q
                    depth = deepest[n]
                    out[first + k, column + t * Q + q] = scale * (depth if depth <= 0.0 else np.sqrt(nearest[n]))
