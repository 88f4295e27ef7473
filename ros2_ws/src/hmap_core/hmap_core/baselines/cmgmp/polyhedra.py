"""Convex polyhedra, and the points at which two of them touch: contact manifolds, compiled."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.spatial import ConvexHull

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.convex import ConvexSet
from hmap_core.transforms import apply

SAME_PLANE = 1e-9  # of planes' coefficients
BALL_SIDES = 12  # of the polyhedron in a sphere
MOST = 64  # contact points of a pair, at most
FACE_VERTEX, BODY_VERTEX, EDGES = 0, 1, 2  # kinds of contact points: by whose feature they are
# a pair of edges separates two polyhedra only where it does so by this share of the tolerance more than any face
EDGE_BIAS = 0.1
# cosine to the contact normal below which another plane leads past the corner at which two polyhedra touch
ACROSS = 0.7
PARALLEL = 1e-6  # length of the cross product of parallel unit vectors


@dataclass(frozen=True)
class Polyhedron:
    """A convex polyhedron.

    Attributes:
        vertices: (V, 3).
        normals, offsets: (P, 3), (P,) its planes: ``normals @ x <= offsets`` inside.
        edges: (E, 2) numbers of vertices.
        directions: (D, 3) of the edges, each once.
    """

    vertices: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    edges: np.ndarray
    directions: np.ndarray

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """What compiled code takes of it."""
        return self.vertices, self.normals, self.offsets, self.edges, self.directions


def polyhedron(points: np.ndarray) -> Polyhedron:
    """The convex hull of points (n, 3)."""
    hull = ConvexHull(points)
    planes = np.unique(np.round(hull.equations, 9), axis=0)
    vertices = np.ascontiguousarray(points[hull.vertices])
    normals, offsets = np.ascontiguousarray(planes[:, :3]), np.ascontiguousarray(-planes[:, 3])
    size = np.ptp(vertices, axis=0).max()
    on = np.abs(vertices @ normals.T - offsets) < 1e-6 * size  # (V, P)
    pairs = [(i, j) for i in range(len(vertices)) for j in range(i + 1, len(vertices)) if np.sum(on[i] & on[j]) >= 2]
    edges = np.array(pairs, np.int64).reshape(-1, 2)
    ways = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ways *= np.where(ways[np.arange(len(ways)), np.abs(ways).argmax(axis=1)] < 0.0, -1.0, 1.0)[:, None]
    return Polyhedron(vertices, normals, offsets, edges, np.unique(np.round(ways, 9), axis=0))


def polyhedra(shapes: ConvexSet, T: np.ndarray) -> list[Polyhedron]:
    """The polyhedra of a set of shapes at T (7,); the sphere swept along rounded ones gets corners."""
    return [polyhedron(apply(T, _corners(shapes.hull(s), float(shapes.radius[s])))) for s in range(len(shapes))]


def _corners(points: np.ndarray, radius: float) -> np.ndarray:
    """Points (n, 3) of a hull, swept by a sphere, as the vertices of a polyhedron."""
    return points if radius == 0.0 else (points[:, None] + radius * _ball()).reshape(-1, 3)


@lru_cache
def _ball() -> np.ndarray:
    """Points (n, 3) on the unit sphere."""
    height = np.sin(np.linspace(-0.5, 0.5, 5) * np.pi)
    angle = 2.0 * np.pi * np.arange(BALL_SIDES) / BALL_SIDES
    rings = [np.outer(np.sqrt(max(0.0, 1.0 - h * h)), [1.0, 1.0]) * np.c_[np.cos(angle), np.sin(angle)] for h in height]
    return np.concatenate([np.c_[ring, np.full(len(ring), h)] for ring, h in zip(rings, height, strict=True)])


@njit(**OPTIONS)
def _separation(normals, offsets, vertices):
    """The plane that separates vertices best from a polyhedron, and by how much."""
    best, which = -np.inf, -1
    for j in range(normals.shape[0]):
        nearest = np.inf
        for i in range(vertices.shape[0]):
            d = normals[j] @ vertices[i] - offsets[j]
            if d < nearest:
                nearest = d
        if nearest > best:
            best, which = nearest, j
    return best, which


@njit(**OPTIONS)
def _towards(normals, offsets, vertices, sign, least, normal, wanted, best):
    """The plane that separates vertices by ``least`` or more whose normal is nearest to a wanted one.

    Returns:
        The largest of its cosine and ``best``, its number or -1, and the number of the best plane across ``normal``
        or -1, with its separation.
    """
    which, across, far = -1, -1, -np.inf
    for j in range(normals.shape[0]):
        cosine = sign * (normals[j] @ wanted)
        turned = abs(normals[j] @ normal) < ACROSS
        if cosine <= best and not turned:
            continue
        nearest = np.inf
        for i in range(vertices.shape[0]):
            nearest = min(nearest, normals[j] @ vertices[i] - offsets[j])
        if nearest < least:
            continue
        if cosine > best:
            best, which = cosine, j
        if turned and nearest > far:
            far, across = nearest, j
    return best, which, across, far


@njit(**OPTIONS)
def _inside(normals, offsets, point, tolerance, left_out):
    for j in range(normals.shape[0]):
        if j != left_out and normals[j] @ point - offsets[j] > tolerance:
            return False
    return True


@njit(**OPTIONS)
def _vertices(
    vertices, normal, level, widest, normals, offsets, left_out, tolerance, kind, count, points, gaps, labels
):  # fmt: skip
    """Writes the vertices of one polyhedron that touch the other one, after ``count`` points; the new number.

    Args:
        vertices: of the one; normal: away from the other one, of which level is the highest plane along it.
        widest: largest gap.
        normals, offsets: of the other one's faces; left_out: number of the face in contact, or -1.
    """
    for k in range(vertices.shape[0]):
        gap = normal @ vertices[k] - level
        if gap <= widest and count < MOST and _inside(normals, offsets, vertices[k], tolerance, left_out):
            points[count], gaps[count] = vertices[k], gap
            labels[count, 0], labels[count, 1], labels[count, 2] = kind, k, 0
            count += 1
    return count


@njit(**OPTIONS)
def _crossing(a, b, c, d):
    """Parameters of the closest points of the lines a-b and c-d; both -1 where they are parallel."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = u @ u, u @ v, v @ v, u @ w, v @ w
    det = uu * vv - uv * uv
    if det < PARALLEL * uu * vv:
        return -1.0, -1.0
    return (uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det


@njit(**OPTIONS)
def _extent(vertices, axis):
    low, high = np.inf, -np.inf
    for k in range(vertices.shape[0]):
        d = axis[0] * vertices[k, 0] + axis[1] * vertices[k, 1] + axis[2] * vertices[k, 2]
        low, high = min(low, d), max(high, d)
    return low, high


@njit(**OPTIONS)
def _edge_contact(A, edges_a, B, edges_b, normal, gap, tolerance, points, gaps, labels):
    """Writes the point at which the supporting edges of A and B along a normal cross; the number of points."""
    low, high = _extent(A, normal)[0], _extent(B, normal)[1]
    for i in range(edges_a.shape[0]):
        a, b = A[edges_a[i, 0]], A[edges_a[i, 1]]
        if max(normal @ a, normal @ b) - low > tolerance:
            continue
        for j in range(edges_b.shape[0]):
            c, d = B[edges_b[j, 0]], B[edges_b[j, 1]]
            if high - min(normal @ c, normal @ d) > tolerance:
                continue
            s, t = _crossing(a, b, c, d)
            if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
                points[0], gaps[0] = a + s * (b - a), gap
                labels[0, 0], labels[0, 1], labels[0, 2] = EDGES, i, j
                return 1
    return 0


@njit(**OPTIONS)
def manifold(
    A, normals_a, offsets_a, edges_a, directions_a, B, normals_b, offsets_b, edges_b, directions_b, tolerance,
    wanted, points, gaps, labels, other,
):  # fmt: skip
    """Where the polyhedron A touches B; both are in the same frame.

    Args:
        tolerance: what is nearer touches.
        wanted: (3,) normal to be preferred where there are several, as at a corner; zero: none.
        points: (MOST, 3), gaps: (MOST,), labels: (MOST, 3); written.
        other: (3,); written: another normal that the contact may have; zero: none.

    Returns:
        The number of points, the normal (3,) into A, and the distance along the best normal, negative inside.
    """
    other[:] = 0.0
    best, plane = _separation(normals_b, offsets_b, A)
    normal = normals_b[max(plane, 0)].copy()
    if best > tolerance:
        return 0, normal, best
    own, own_plane = _separation(normals_a, offsets_a, B)
    if own > best + 1e-3 * tolerance:
        best, normal, plane = own, -normals_a[own_plane], -1
        if best > tolerance:
            return 0, normal, best
    else:
        own_plane = -1
    count = 0
    # at a corner, the contact may have one normal or another
    cosine = normal @ wanted + 1e-9
    cosine, by_b, across_b, far_b = _towards(normals_b, offsets_b, A, 1.0, -tolerance, normal, wanted, cosine)
    _, by_a, across_a, far_a = _towards(normals_a, offsets_a, B, -1.0, -tolerance, normal, wanted, cosine)
    first = normal
    if by_a >= 0:
        normal, plane, own_plane = -normals_a[by_a], -1, by_a
    elif by_b >= 0:
        normal, plane, own_plane = normals_b[by_b].copy(), by_b, -1
    if by_a >= 0 or by_b >= 0:
        if abs(normal @ first) < ACROSS:
            other[:] = first
    elif across_b >= 0 and far_b >= far_a:
        other[:] = normals_b[across_b]
    elif across_a >= 0:
        other[:] = -normals_a[across_a]
    level, low = _extent(B, normal)[1], _extent(A, normal)[0]
    widest = min(low - level, 0.0) + tolerance
    count = _vertices(
        A, normal, level, widest, normals_b, offsets_b, plane, tolerance, BODY_VERTEX, count, points, gaps, labels
    )
    count = _vertices(
        B, -normal, -low, widest, normals_a, offsets_a, own_plane, tolerance, FACE_VERTEX, count, points, gaps, labels
    )
    for i in range(edges_a.shape[0]):
        a, b = A[edges_a[i, 0]], A[edges_a[i, 1]]
        if min(normal @ a, normal @ b) - level > tolerance:
            continue
        for j in range(edges_b.shape[0]):
            c, d = B[edges_b[j, 0]], B[edges_b[j, 1]]
            if low - max(normal @ c, normal @ d) > tolerance:
                continue
            s, t = _crossing(a, b, c, d)
            if 0.0 < s < 1.0 and 0.0 < t < 1.0 and count < MOST:
                x = a + s * (b - a)
                gap = normal @ (x - (c + t * (d - c)))
                if gap <= tolerance:
                    new = True
                    for k in range(count):
                        e = points[k] - x
                        if e @ e < 4.0 * tolerance * tolerance:
                            new = False
                    if new:
                        points[count], gaps[count] = x, gap
                        labels[count, 0], labels[count, 1], labels[count, 2] = EDGES, i, j
                        count += 1
    if best < -tolerance or count == 0:
        face, crossed = best, False
        for i in range(directions_a.shape[0]):
            for j in range(directions_b.shape[0]):
                u, v = directions_a[i], directions_b[j]
                axis = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
                length = np.sqrt(axis @ axis)
                if length < PARALLEL:
                    continue
                axis /= length
                low_a, high_a = _extent(A, axis)
                low_b, high_b = _extent(B, axis)
                above, below = low_a - high_b, low_b - high_a
                if max(above, below) > max(best, face + EDGE_BIAS * tolerance):
                    best, crossed = max(above, below), True
                    normal = axis if above >= below else -axis
        if crossed:
            other[:] = 0.0
            count = 0
            if best <= tolerance:
                count = _edge_contact(A, edges_a, B, edges_b, normal, best, tolerance, points, gaps, labels)
    return count, normal, best
