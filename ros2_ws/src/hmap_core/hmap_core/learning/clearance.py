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
def box_distances(points, R, p, half, limit):
    """Distance (N,) of points (N, 3) from the nearest of S boxes, at most ``limit``; negative inside."""
    N, S = points.shape[0], p.shape[0]
    out = np.empty(N)
    for n in range(N):
        best = limit
        for s in range(S):
            x, y, z = points[n, 0] - p[s, 0], points[n, 1] - p[s, 1], points[n, 2] - p[s, 2]
            a = abs(R[s, 0, 0] * x + R[s, 1, 0] * y + R[s, 2, 0] * z) - half[s, 0]
            if a >= best:
                continue
            b = abs(R[s, 0, 1] * x + R[s, 1, 1] * y + R[s, 2, 1] * z) - half[s, 1]
            if b >= best:
                continue
            c = abs(R[s, 0, 2] * x + R[s, 1, 2] * y + R[s, 2, 2] * z) - half[s, 2]
            if c >= best:
                continue
            inside = max(a, b, c)
            if inside <= 0.0:
                best = min(best, inside)
            else:
                a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
                best = min(best, np.sqrt(a * a + b * b + c * c))
        out[n] = best
    return out
