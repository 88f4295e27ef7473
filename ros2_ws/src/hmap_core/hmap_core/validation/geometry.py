"""Convex shapes: exact distances with coal, bounding boxes, and vertices."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import coal
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from hmap_core.validation import rigid
from hmap_core.validation.document import ShapeData
from hmap_core.validation.files import invalid_plan, locate, mesh_points

RIM_POINTS = 64  # vertices of the polygon that approximates a circle
BALL_POINTS = 128  # vertices of the polytope that approximates a ball; its top and bottom are exact
MAX_DISTANCE = 1e3  # m, larger than any scene; a larger result of coal counts as penetration


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex shape in its own frame.

    Attributes:
        kind, size: as in the plan file; a mesh is its convex hull.
        geometry: the coal object.
        points: (V, 3) vertices. The shape is their convex hull swept by a ball of radius ``ball``, up to 0.2 % for the
            rims of cylinders, which are polygons of 64 vertices.
        ball: radius of the sweeping ball, m.
        center, half: (3,) centre and half extents of the bounding box, m.
        volume: m^3.
        centroid: (3,) of uniform density, m.
    """

    kind: str
    size: tuple[float, ...]
    geometry: coal.ShapeBase
    points: np.ndarray
    ball: float
    center: np.ndarray
    half: np.ndarray
    volume: float
    centroid: np.ndarray

    @cached_property
    def faces(self) -> np.ndarray:
        """The halfspaces (m, 4) of the hull of the points, see :func:`halfspaces`."""
        return halfspaces(self.points)

    def support(self, directions: np.ndarray) -> np.ndarray:
        """How far the shape reaches from its origin along unit directions (n, 3): (n,) in metres."""
        if self.kind == "box" and self.ball == 0.0:
            return np.abs(directions) @ self.half
        if self.kind == "cylinder":
            return self.half[0] * np.hypot(directions[:, 0], directions[:, 1]) + self.half[2] * np.abs(directions[:, 2])
        return (directions @ self.points.T).max(axis=1) + self.ball


def _solid(
    kind: str,
    size: tuple[float, ...],
    geometry: coal.ShapeBase,
    points: np.ndarray,
    ball: float,
    half: ArrayLike,
    volume: float,
) -> Solid:
    return Solid(kind, tuple(size), geometry, points, ball, np.zeros(3), np.asarray(half, float), volume, np.zeros(3))


def _box(x: float, y: float, z: float) -> Solid:
    half = np.array([x, y, z]) / 2.0
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
    return _solid("box", (x, y, z), coal.Box(x, y, z), corners, 0.0, half, x * y * z)


def _cylinder(radius: float, height: float) -> Solid:
    angles = 2.0 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(RIM_POINTS, height / 2.0)])
    points = np.vstack([rim, rim * [1, 1, -1]])
    half = (radius, radius, height / 2.0)
    volume = np.pi * radius**2 * height
    return _solid("cylinder", (radius, height), coal.Cylinder(radius, height), points, 0.0, half, volume)


def _sphere(radius: float) -> Solid:
    volume = 4.0 / 3.0 * np.pi * radius**3
    return _solid("sphere", (radius,), coal.Sphere(radius), np.zeros((1, 3)), radius, (radius,) * 3, volume)


def _capsule(radius: float, height: float) -> Solid:
    points = np.array([[0.0, 0.0, -height / 2.0], [0.0, 0.0, height / 2.0]])
    half = (radius, radius, height / 2.0 + radius)
    volume = np.pi * radius**2 * height + 4.0 / 3.0 * np.pi * radius**3
    return _solid("capsule", (radius, height), coal.Capsule(radius, height), points, radius, half, volume)


def hull(points: np.ndarray, name: str) -> Solid:
    """Convex hull of points.

    Args:
        points: (V, 3), m.
        name: of the shape in error messages.

    Returns:
        The shape.

    Raises:
        InputError: INVALID_PLAN_FILE; the points span no volume.
    """
    try:
        result = ConvexHull(points)
    except QhullError as error:
        raise invalid_plan(f"{name}: its points span no volume") from error
    vertices = points[result.vertices]
    index = np.full(len(points), -1)
    index[result.vertices] = np.arange(len(result.vertices))
    inside = vertices.mean(axis=0)
    triangles = _outward(vertices, index[result.simplices], inside)
    corners = vertices[triangles]
    volumes = np.einsum("ij,ij->i", corners[:, 0] - inside, np.cross(corners[:, 1] - inside, corners[:, 2] - inside))
    centroid = (volumes @ (corners.sum(axis=1) + inside) / 4.0) / volumes.sum()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    geometry = _coal_convex(vertices, triangles)
    return Solid("mesh", (), geometry, vertices, 0.0, (low + high) / 2, (high - low) / 2, result.volume, centroid)


def _outward(vertices: np.ndarray, triangles: np.ndarray, inside: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - inside) < 0.0
    triangles = triangles.copy()
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles


def _coal_convex(vertices: np.ndarray, triangles: np.ndarray) -> coal.ShapeBase:
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices:
        points.append(vertex)
    for triangle in triangles:
        faces.append(coal.Triangle(*map(int, triangle)))
    return coal.Convex(points, faces)


_PRIMITIVES: dict[str, Callable[..., Solid]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "capsule": _capsule,
}


@lru_cache(maxsize=256)
def solid(kind: str, size: tuple[float, ...], mesh: str | None = None) -> Solid:
    """Builds a convex shape.

    Args:
        kind: as in the plan file.
        size: as in the plan file, m; the scale of a mesh.
        mesh: URI of the file of a mesh.

    Returns:
        The shape, from a cache.

    Raises:
        InputError: INVALID_PLAN_FILE; the mesh file is missing, cannot be read or spans no volume.
    """
    if kind in _PRIMITIVES:
        return _PRIMITIVES[kind](*size)
    if mesh is None:
        raise invalid_plan(f"a shape of kind {kind!r} needs a mesh file")
    return hull(mesh_points(locate(mesh)) * np.asarray(size), f"mesh {mesh!r}")


def solid_of(shape: ShapeData) -> Solid:
    """Builds the convex shape that a plan file describes.

    Raises:
        InputError: INVALID_PLAN_FILE; the mesh file is missing, cannot be read or spans no volume.
    """
    if shape.vertices is not None:
        return hull(shape.vertices * np.asarray(shape.size), "mesh")
    return solid(shape.kind, shape.size, shape.mesh)


def halfspaces(points: np.ndarray) -> np.ndarray:
    """The hull of points (V, 3) as rows [normal, offset] with normal @ x + offset <= 0 inside."""
    return np.unique(np.round(ConvexHull(points).equations, 12), axis=0)


@dataclass(frozen=True)
class Polytope:
    """A convex polytope: vertices (V, 3) and halfspaces (m, 4), as :func:`halfspaces` returns them."""

    points: np.ndarray
    faces: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray) -> "Polytope":
        """The hull of points (V, 3)."""
        return cls(points, halfspaces(points))

    @classmethod
    def around(cls, shape: Solid, R: np.ndarray, p: np.ndarray) -> "Polytope":
        """The polytope of :func:`polytope_points`, at a rotation R (3, 3) and a position p (3,)."""
        points = polytope_points(shape, R, p)
        if shape.ball > 0.0:
            return cls.of(points)
        normals = shape.faces[:, :3] @ R.T
        return cls(points, np.column_stack([normals, shape.faces[:, 3] - normals @ p]))


def polytope_points(shape: Solid, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Vertices of a polytope that approximates a shape.

    The lowest and highest points of balls are exact, since these carry the weight.

    Args:
        shape: the shape.
        R: (3, 3) rotation of its frame.
        p: (3,) position of its frame, m.

    Returns:
        (V, 3), world frame.
    """
    points = shape.points @ R.T + p
    if shape.ball == 0.0:
        return points
    return (points[:, None, :] + shape.ball * _unit_ball()[None]).reshape(-1, 3)


@lru_cache(maxsize=1)
def _unit_ball() -> np.ndarray:
    z = np.linspace(-1.0, 1.0, BALL_POINTS)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(BALL_POINTS)  # Fibonacci lattice
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


@lru_cache(maxsize=1)
def _request() -> coal.DistanceRequest:
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    return request


def transform(R: np.ndarray, p: np.ndarray) -> coal.Transform3s:
    """The coal transform of a rotation R (3, 3) and a position p (3,)."""
    return coal.Transform3s(np.ascontiguousarray(R), np.ascontiguousarray(p))


class Gauge:
    """Measures the signed distance of a pair of shapes; negative values are penetration depths.

    Distances are computed by GJK (Gilbert, Johnson and Keerthi 1988) and EPA (van den Bergen 2001) in coal.
    """

    def __init__(self, a: Solid, b: Solid):
        self._keep = (a, b)  # the coal functor only borrows the geometries
        self._compute = coal.ComputeDistance(a.geometry, b.geometry)
        self.result = coal.DistanceResult()

    def distance(self, Ta: coal.Transform3s, Tb: coal.Transform3s) -> float:
        """Signed distance in metres at two coal transforms; ``-MAX_DISTANCE`` if coal fails."""
        self.result.clear()
        value = self._compute(Ta, Tb, _request(), self.result)
        return value if abs(value) < MAX_DISTANCE else -MAX_DISTANCE

    def witness(self, Ta: coal.Transform3s, Tb: coal.Transform3s) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance with witness points, at two coal transforms.

        Returns:
            The distance in metres, the nearest (or deepest) points (3,) of both shapes, and the unit normal (3,) from a
            to b.
        """
        value = self.distance(Ta, Tb)
        r = self.result
        return value, np.array(r.getNearestPoint1()), np.array(r.getNearestPoint2()), np.array(r.normal)


@dataclass(frozen=True)
class Boxes:
    """n oriented boxes. The components come first, so that NumPy vectorises over the boxes.

    Attributes:
        axes: (3, 3, n) rotation matrices; the columns are the directions of the sides.
        center: (3, n), m.
        half: (3, n) half extents, m.
    """

    axes: np.ndarray
    center: np.ndarray
    half: np.ndarray

    @classmethod
    def around(cls, shape: Solid, R: np.ndarray, p: np.ndarray) -> "Boxes":
        """Bounding boxes of a shape at rotations R (n, 3, 3) and positions p (n, 3)."""
        center = p + rigid.apply(R, shape.center)
        return cls(np.moveaxis(R, 0, -1), center.T, np.broadcast_to(shape.half[:, None], (3, len(p))))

    @classmethod
    def join(cls, boxes: list["Boxes"], check_time: Callable[[], object]) -> "Boxes":
        """Concatenates several sets of boxes; calls ``check_time`` in between."""
        joined = []
        for part in ([b.axes for b in boxes], [b.center for b in boxes], [b.half for b in boxes]):
            check_time()
            joined.append(np.concatenate(part, axis=-1))
        return cls(*joined)

    def __getitem__(self, index: np.ndarray) -> "Boxes":
        return Boxes(self.axes[..., index], self.center[:, index], self.half[:, index])


def box_gap(a: Boxes, b: Boxes) -> np.ndarray:
    """Lower bounds on the distances of shapes from their bounding boxes.

    The gaps along the three axes of one box are distances along orthogonal directions, so their squares add up.

    Args:
        a, b: n boxes each.

    Returns:
        (n,) in metres; -inf where the boxes overlap.
    """
    offset = (b.center - a.center)[:, None]
    in_a, in_b = np.abs((a.axes * offset).sum(axis=0)), np.abs((b.axes * offset).sum(axis=0))
    turned = np.abs((a.axes[:, :, None] * b.axes[:, None]).sum(axis=0))  # (3, 3, n): axis of a, axis of b
    gap_a = np.maximum(in_a - a.half - (turned * b.half).sum(axis=1), 0.0)
    gap_b = np.maximum(in_b - b.half - (turned * a.half[:, None]).sum(axis=0), 0.0)
    bound = np.sqrt(np.maximum((gap_a * gap_a).sum(axis=0), (gap_b * gap_b).sum(axis=0)))
    return np.where(bound > 0.0, bound, -np.inf)
