"""Bodies as sets of convex shapes, and distances between sets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.edges import hull_edges
from hmap_core.collision.epa import FAR
from hmap_core.collision.gjk import distance_within, signed_distance
from hmap_core.collision.simplex import WORK
from hmap_core.exceptions import Code, InputError
from hmap_core.mesh_files import read_hull
from hmap_core.transforms import apply
from hmap_core.types import Shape, ShapeKind

CYLINDER_SIDES = 32  # sides of the circumscribed polygon of a circle, which exceeds the radius by at most 0.5 %

__all__ = ["ConvexSet", "convex_set", "hull_vertices", "set_distance", "sets_closer", "signed_distance", "transformed"]


@dataclass(frozen=True, eq=False)
class ConvexSet:
    """S convex shapes in one frame: hulls of vertices, each swept by a sphere.

    Attributes:
        vertices: (V, 3) of all shapes, m.
        start: (S + 1,) shape s has the vertices ``start[s]:start[s + 1]``.
        radius: (S,) of the sweeping sphere, m.
        center, bound: (S, 3), (S,) centre and radius of a bounding sphere of each swept shape, m.
        edges: S arrays, the edges of each hull, see :mod:`hmap_core.collision.edges`.
    """

    vertices: np.ndarray
    start: np.ndarray
    radius: np.ndarray
    center: np.ndarray
    bound: np.ndarray
    edges: Sequence[np.ndarray]

    def __len__(self) -> int:
        return len(self.radius)

    def hull(self, s: int) -> np.ndarray:
        """Vertices (n, 3) of shape s."""
        return self.vertices[self.start[s] : self.start[s + 1]]


def hull_vertices(shape: Shape) -> tuple[np.ndarray, float]:
    """Converts a shape to a swept hull.

    Args:
        shape: the shape.

    Returns:
        Vertices (n, 3) in the body frame and radius of the sweeping sphere, m.

    Raises:
        InputError: INVALID_SCENE; a mesh cannot be read or spans no volume.
    """
    size = np.asarray(shape.size, float)
    radius = 0.0
    if shape.kind == ShapeKind.BOX:
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        points = signs * size / 2
    elif shape.kind == ShapeKind.CYLINDER:
        angle = 2 * np.pi * (np.arange(CYLINDER_SIDES) + 0.5) / CYLINDER_SIDES
        rim = size[0] / np.cos(np.pi / CYLINDER_SIDES) * np.c_[np.cos(angle), np.sin(angle)]
        points = np.r_[np.c_[rim, np.full(len(rim), -size[1] / 2)], np.c_[rim, np.full(len(rim), size[1] / 2)]]
    elif shape.kind == ShapeKind.SPHERE:
        points, radius = np.zeros((1, 3)), float(size[0])
    elif shape.kind == ShapeKind.CAPSULE:
        points, radius = np.array([[0, 0, -size[1] / 2], [0, 0, size[1] / 2]]), float(size[0])
    elif shape.mesh is None:
        raise InputError("a mesh shape has no file", Code.INVALID_SCENE)
    else:
        points = read_hull(shape.mesh).vertices * size
    return apply(shape.pose, points), radius


def bounding_sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """A small enclosing sphere of points (n, 3): centre (3,) and radius.

    The iteration is that of Badoiu and Clarkson, "Smaller core-sets for balls", 2003; the final radius is exact for its
    centre, so the sphere always contains all points.
    """
    return _bounding_sphere(np.ascontiguousarray(points, float))


@nb.njit(**OPTIONS)
def _farthest(points, center):
    """Index of the point (n, 3) farthest from the centre (3,), and its distance."""
    at, best = 0, -1.0
    for i in range(len(points)):
        x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        d = np.sqrt(x * x + y * y + z * z)
        if d > best:
            at, best = i, d
    return at, best


@nb.njit(**OPTIONS)
def _bounding_sphere(points):
    fallback, center = np.empty(3), np.empty(3)
    for x in range(3):
        fallback[x] = center[x] = (points[:, x].min() + points[:, x].max()) / 2
    for k in range(60):
        at, _ = _farthest(points, center)
        for x in range(3):
            center[x] = center[x] + (points[at, x] - center[x]) / (k + 2)
    radius, other = _farthest(points, center)[1], _farthest(points, fallback)[1]
    return (center, radius) if radius < other else (fallback, other)


class HullEdges(Sequence):
    """The edges of some hulls, see :mod:`hmap_core.collision.edges`; those of a hull are found when first asked for.

    Args:
        hulls: vertices (n, 3) of each.
    """

    def __init__(self, hulls: Sequence[np.ndarray]):
        self._hulls = hulls
        self._found: dict[int, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._hulls)

    def __getitem__(self, s: Any) -> Any:
        if isinstance(s, slice):
            return tuple(self[k] for k in range(*s.indices(len(self))))
        if not 0 <= s < len(self._hulls):
            raise IndexError(s)
        if s not in self._found:
            self._found[s] = hull_edges(self._hulls[s])
        return self._found[s]


def from_hulls(hulls: Sequence[tuple[np.ndarray, float]]) -> ConvexSet:
    """Builds a set from hulls.

    Args:
        hulls: vertices (n, 3) and sphere radius of each, m.
    """
    if not hulls:
        empty = np.zeros((0, 3))
        return ConvexSet(empty, np.zeros(1, np.int64), np.zeros(0), empty, np.zeros(0), ())
    spheres = [bounding_sphere(points) for points, _ in hulls]
    radius = np.array([r for _, r in hulls])
    return ConvexSet(
        np.ascontiguousarray(np.concatenate([points for points, _ in hulls])),
        np.concatenate([[0], np.cumsum([len(points) for points, _ in hulls])]).astype(np.int64),
        radius,
        np.array([c for c, _ in spheres]),
        np.array([b for _, b in spheres]) + radius,
        HullEdges([points for points, _ in hulls]),
    )


def convex_set(shapes: Sequence[Shape]) -> ConvexSet:
    """The convex set of a body's shapes in the body frame, from a cache.

    Raises:
        InputError: INVALID_SCENE; a mesh cannot be read or spans no volume.
    """
    key = tuple((s.kind, s.size, s.pose.tobytes(), s.mesh) for s in shapes)
    if key not in _SETS:
        _SETS[key] = from_hulls([hull_vertices(shape) for shape in shapes])
    return _SETS[key]


_SETS: dict[tuple, ConvexSet] = {}


@nb.njit(**OPTIONS)
def _rotation(T):
    """Rotation matrix (3, 3) of a pose (7,); compiled, since a call from Python takes longer than the computation."""
    x, y, z, w = T[3], T[4], T[5], T[6]
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return R


@nb.njit(**OPTIONS)
def _moved(points, T):
    R, found = _rotation(T), np.empty((len(points), 3))
    for i in range(len(points)):
        for x in range(3):
            found[i, x] = R[x, 0] * points[i, 0] + R[x, 1] * points[i, 1] + R[x, 2] * points[i, 2] + T[x]
    return found


def transformed(shapes: ConvexSet, T: np.ndarray) -> ConvexSet:
    """The set in another frame.

    Args:
        shapes: the set.
        T: (7,) pose of the set's frame in the other frame.
    """
    vertices, center = _moved(shapes.vertices, T), _moved(shapes.center, T)
    return ConvexSet(vertices, shapes.start, shapes.radius, center, shapes.bound, shapes.edges)


@nb.njit(**OPTIONS)
def _centers_apart(cA, RA, pA, cB, RB, pB):
    d = 0.0
    for x in range(3):
        u = RA[x, 0] * cA[0] + RA[x, 1] * cA[1] + RA[x, 2] * cA[2] + pA[x]
        w = RB[x, 0] * cB[0] + RB[x, 1] * cB[1] + RB[x, 2] * cB[2] + pB[x]
        d += (u - w) * (u - w)
    return np.sqrt(d)


@nb.njit(**OPTIONS)
def sets_closer(VA, sA, radA, cA, bA, RA, pA, VB, sB, radB, cB, bB, RB, pB, min_distance):
    """Whether any shape of set A is closer than ``min_distance`` (m) to any shape of set B.

    The arrays are those of :class:`ConvexSet`; (RA, pA) and (RB, pB) are the frames of the sets.
    """
    witness = np.empty((3, 3))
    work = np.zeros(WORK)
    for i in range(len(radA)):
        for j in range(len(radB)):
            if _centers_apart(cA[i], RA, pA, cB[j], RB, pB) - bA[i] - bB[j] > min_distance:
                continue
            work[:3] = pA - pB
            d = distance_within(
                VA[sA[i] : sA[i + 1]],
                RA,
                pA,
                radA[i],
                VB[sB[j] : sB[j + 1]],
                RB,
                pB,
                radB[j],
                min_distance,
                witness,
                work,
            )
            if d < min_distance:
                return True
    return False


@nb.njit(**OPTIONS)
def sets_distance(VA, sA, radA, cA, bA, T_a, VB, sB, radB, cB, bB, T_b, cutoff):
    """Smallest signed distance (m) of two sets at poses T_a and T_b (7,); above ``cutoff`` only a lower bound.

    The other arrays are those of :class:`ConvexSet`.
    """
    RA, pA, RB, pB = _rotation(T_a), T_a[:3], _rotation(T_b), T_b[:3]
    witness = np.empty((3, 3))
    work = np.zeros(WORK)
    best = FAR
    for i in range(len(radA)):
        for j in range(len(radB)):
            limit = min(best, cutoff)
            if _centers_apart(cA[i], RA, pA, cB[j], RB, pB) - bA[i] - bB[j] > limit:
                continue
            work[:3] = pA - pB
            d = distance_within(
                VA[sA[i] : sA[i + 1]], RA, pA, radA[i], VB[sB[j] : sB[j + 1]], RB, pB, radB[j], limit, witness, work
            )
            best = min(best, d)
    return best


@nb.njit(**OPTIONS)
def sets_nearest(VA, sA, radA, cA, bA, places, VB, sB, radB, cB, bB, owner, best):
    """Smallest distances (m) of set A, over several poses, from groups of shapes of set B.

    Args:
        places: (K, 7) poses of set A.
        owner: (SB,) group of each shape of set B, which is given in the world frame.
        best: (N,) in and out; lowered to the distance of each group.

    The other arrays are those of :class:`ConvexSet`.
    """
    witness = np.empty((3, 3))
    work = np.zeros(WORK)
    RB, pB = np.eye(3), np.zeros(3)
    for k in range(len(places)):
        RA, pA = _rotation(places[k]), places[k, :3]
        for i in range(len(radA)):
            for j in range(len(radB)):
                limit = best[owner[j]]
                if _centers_apart(cA[i], RA, pA, cB[j], RB, pB) - bA[i] - bB[j] > limit:
                    continue
                work[:3] = pA
                d = distance_within(
                    VA[sA[i] : sA[i + 1]], RA, pA, radA[i], VB[sB[j] : sB[j + 1]], RB, pB, radB[j], limit, witness, work
                )
                best[owner[j]] = min(limit, d)


def set_distance(A: ConvexSet, T_a: np.ndarray, B: ConvexSet, T_b: np.ndarray, cutoff: float = FAR) -> float:
    """Smallest signed distance of two sets.

    Args:
        A: the first set, at the pose ``T_a`` (7,).
        T_a: (7,).
        B: the second set, at the pose ``T_b`` (7,).
        T_b: (7,).
        cutoff: m; a result above it is only a lower bound.

    Returns:
        The distance in metres; negative values are penetration depths.
    """
    return sets_distance(
        A.vertices, A.start, A.radius, A.center, A.bound, T_a,
        B.vertices, B.start, B.radius, B.center, B.bound, T_b, cutoff,
    )  # fmt: skip
