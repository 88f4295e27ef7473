"""Convex shapes: exact distances through coal, boxes around them, and their points."""

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.validation import rigid
from hmap_core.validation.document import ShapeData
from hmap_core.validation.files import locate, mesh_points, unusable

RIM = 64  # corners by which a circle is replaced where a polytope is needed
BALL = 128  # points by which a ball is replaced there; two of them are its exact top and bottom
NO_ANSWER = 1e3  # m, larger than any scene; what is beyond is no distance, and never lets a plan pass


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex shape in its own frame.

    Attributes:
        kind, size: as in the plan file; a mesh is its convex hull.
        geometry: the coal object.
        points: (V, 3) the shape is their convex hull, swept by a ball of radius ``ball``, or lies within 0.2 % of it
            (the 64 corners of a cylinder's rims).
        center, half: the box around it.
        volume, centroid: of uniform density.
    """

    kind: str
    size: tuple[float, ...]
    geometry: object
    points: np.ndarray
    ball: float
    center: np.ndarray
    half: np.ndarray
    volume: float
    centroid: np.ndarray


def _solid(kind, size, geometry, points, ball, half, volume) -> Solid:
    return Solid(kind, tuple(size), geometry, points, ball, np.zeros(3), np.asarray(half, float), volume, np.zeros(3))


def _box(x: float, y: float, z: float) -> Solid:
    half = np.array([x, y, z]) / 2.0
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
    return _solid("box", (x, y, z), coal.Box(x, y, z), corners, 0.0, half, x * y * z)


def _cylinder(radius: float, height: float) -> Solid:
    angles = 2.0 * np.pi * np.arange(RIM) / RIM
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(RIM, height / 2.0)])
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
    """The convex hull of points (V, 3).

    Raises:
        InputError: the points have no volume; ``name`` says whose they are.
    """
    try:
        result = ConvexHull(points)
    except QhullError as error:
        raise unusable(f"{name}: its points span no volume") from error
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


def _coal_convex(vertices: np.ndarray, triangles: np.ndarray):
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices:
        points.append(vertex)
    for triangle in triangles:
        faces.append(coal.Triangle(*map(int, triangle)))
    return coal.Convex(points, faces)


_PRIMITIVES = {"box": _box, "cylinder": _cylinder, "sphere": _sphere, "capsule": _capsule}


@lru_cache(maxsize=256)
def solid(kind: str, size: tuple[float, ...], mesh: str | None = None) -> Solid:
    """The convex shape of a kind and size (of the plan file); meshes by URI, scaled by ``size``."""
    if kind in _PRIMITIVES:
        return _PRIMITIVES[kind](*size)
    return hull(mesh_points(locate(mesh)) * np.asarray(size), f"mesh {mesh!r}")


def solid_of(shape: ShapeData) -> Solid:
    """The convex shape that a plan file describes."""
    if shape.vertices is not None:
        return hull(shape.vertices * np.asarray(shape.size), "mesh")
    return solid(shape.kind, shape.size, shape.mesh)


def polytope_points(shape: Solid, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Points (V, 3) in the world whose hull is the shape at rotation R (3, 3) and position p (3,).

    Balls become polytopes whose lowest and highest points are exact, as those carry the weight.
    """
    points = shape.points @ R.T + p
    if shape.ball == 0.0:
        return points
    return (points[:, None, :] + shape.ball * _unit_ball()[None]).reshape(-1, 3)


@lru_cache(maxsize=1)
def _unit_ball() -> np.ndarray:
    z = np.linspace(-1.0, 1.0, BALL)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(BALL)  # Fibonacci lattice
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


@lru_cache(maxsize=1)
def _request():
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    return request


def transform(R: np.ndarray, p: np.ndarray):
    """The coal transform of a rotation (3, 3) and a position (3,)."""
    return coal.Transform3s(np.ascontiguousarray(R), np.ascontiguousarray(p))


class Gauge:
    """Signed distance of one pair of shapes; negative is the depth of penetration."""

    def __init__(self, a: Solid, b: Solid):
        self._keep = (a, b)  # coal's functor refers to the geometries
        self._compute = coal.ComputeDistance(a.geometry, b.geometry)
        self.result = coal.DistanceResult()

    def distance(self, Ta, Tb) -> float:
        """Signed distance in metres at two coal transforms; a penetration of ``NO_ANSWER`` when coal finds none."""
        self.result.clear()
        value = self._compute(Ta, Tb, _request(), self.result)
        return value if abs(value) < NO_ANSWER else -NO_ANSWER

    def witness(self, Ta, Tb) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance, the nearest (deepest) points (3,) of both, and the unit normal from a to b."""
        value = self.distance(Ta, Tb)
        r = self.result
        return value, np.array(r.getNearestPoint1()), np.array(r.getNearestPoint2()), np.array(r.normal)


@dataclass(frozen=True)
class Boxes:
    """n boxes, one or several at many instants, with the components first so that numpy works along the boxes.

    Attributes:
        axes: (3, 3, n) rotation matrices: the directions of a box's sides are the columns.
        center: (3, n) in metres.
        half: (3, n) half sides in metres.
    """

    axes: np.ndarray
    center: np.ndarray
    half: np.ndarray

    @classmethod
    def around(cls, shape: Solid, R: np.ndarray, p: np.ndarray) -> "Boxes":
        """The box around a shape at rotations R (n, 3, 3) and positions p (n, 3)."""
        center = p + rigid.apply(R, shape.center)
        return cls(np.moveaxis(R, 0, -1), center.T, np.broadcast_to(shape.half[:, None], (3, len(p))))

    @classmethod
    def join(cls, boxes: list["Boxes"]) -> "Boxes":
        """All of them in a row."""
        parts = ([b.axes for b in boxes], [b.center for b in boxes], [b.half for b in boxes])
        return cls(*(np.concatenate(part, axis=-1) for part in parts))

    def __getitem__(self, index: np.ndarray) -> "Boxes":
        return Boxes(self.axes[..., index], self.center[:, index], self.half[:, index])


def box_gap(a: Boxes, b: Boxes) -> np.ndarray:
    """Lower bounds (n,) of the distances of the shapes in boxes ``a`` from those in ``b``; -inf where they overlap.

    The gaps along the three axes of one box are distances along orthogonal directions, so they add up by Pythagoras.
    """
    offset = (b.center - a.center)[:, None]
    in_a, in_b = np.abs((a.axes * offset).sum(axis=0)), np.abs((b.axes * offset).sum(axis=0))
    turned = np.abs((a.axes[:, :, None] * b.axes[:, None]).sum(axis=0))  # (3, 3, n): axis of a, axis of b
    gap_a = np.maximum(in_a - a.half - (turned * b.half).sum(axis=1), 0.0)
    gap_b = np.maximum(in_b - b.half - (turned * a.half[:, None]).sum(axis=0), 0.0)
    bound = np.sqrt(np.maximum((gap_a * gap_a).sum(axis=0), (gap_b * gap_b).sum(axis=0)))
    return np.where(bound > 0.0, bound, -np.inf)
