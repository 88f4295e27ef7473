"""Points that are uniformly distributed over a body's surface."""

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import hull_vertices
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import Shape, ShapeKind


def _disc(rng: np.random.Generator, n: int) -> np.ndarray:
    angle, r = 2 * np.pi * rng.random(n), np.sqrt(rng.random(n))
    return np.c_[r * np.cos(angle), r * np.sin(angle)]


def _ball(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.standard_normal((n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def _box_patches(size: np.ndarray) -> list[tuple[float, str, tuple]]:
    a, b, c = size
    return [(s, "face", (axis, sign)) for axis, s in enumerate((b * c, a * c, a * b)) for sign in (-1.0, 1.0)]


def _patches(shape: Shape) -> list[tuple[float, str, tuple]]:
    """The parts of a shape's surface as (area, kind, parameters)."""
    size = np.asarray(shape.size, float)
    if shape.kind == ShapeKind.BOX:
        return _box_patches(size)
    if shape.kind == ShapeKind.SPHERE:
        return [(4 * np.pi * size[0] ** 2, "ball", (0.0,))]
    if shape.kind == ShapeKind.CYLINDER:
        r, h = size
        return [(2 * np.pi * r * h, "side", ()), (np.pi * r * r, "cap", (-1.0,)), (np.pi * r * r, "cap", (1.0,))]
    if shape.kind == ShapeKind.CAPSULE:
        r, h = size
        return [(2 * np.pi * r * h, "side", ()), (4 * np.pi * r * r, "ball", (h / 2,))]
    vertices, _ = hull_vertices(shape)
    hull = ConvexHull(vertices)
    triangles = vertices[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return [(a, "triangle", (t, n)) for a, t, n in zip(areas, triangles, hull.equations[:, :3], strict=True)]


def _on_patch(size, kind: str, parameters: tuple, n: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """n points and outward normals (n, 3) on one patch, in the shape's frame (triangles: in the body's frame)."""
    if kind == "face":
        axis, sign = parameters
        points = (rng.random((n, 3)) - 0.5) * size
        points[:, axis] = sign * size[axis] / 2
        normals = np.zeros((n, 3))
        normals[:, axis] = sign
    elif kind == "side":
        angle = 2 * np.pi * rng.random(n)
        normals = np.c_[np.cos(angle), np.sin(angle), np.zeros(n)]
        points = size[0] * normals + np.c_[np.zeros((n, 2)), size[1] * (rng.random(n) - 0.5)]
    elif kind == "cap":
        normals = np.tile([0.0, 0.0, parameters[0]], (n, 1))
        points = np.c_[size[0] * _disc(rng, n), np.full(n, parameters[0] * size[1] / 2)]
    elif kind == "ball":
        normals = _ball(rng, n)
        points = size[0] * normals
        points[:, 2] += parameters[0] * np.where(normals[:, 2] >= 0.0, 1.0, -1.0)
    else:
        (a, b, c), normal = parameters
        u, v = rng.random((2, n, 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        points = a + u * (b - a) + v * (c - a)
        normals = np.tile(normal, (n, 1))
    return points, normals


def sample_surface(shapes: tuple[Shape, ...], n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Sample points on a body's surface, uniformly by area over the surfaces of all its shapes.

    Args:
        shapes: the body's shapes.
        n: number of points.
        rng: the only source of randomness.

    Returns:
        Points (n, 3) in m and outward unit normals (n, 3), body frame.
    """
    patches = [(shape, *patch) for shape in shapes for patch in _patches(shape)]
    area = np.array([p[1] for p in patches])
    counts = rng.multinomial(n, area / area.sum())
    points, normals = [], []
    for (shape, _, kind, parameters), count in zip(patches, counts, strict=True):
        if count == 0:
            continue
        p, m = _on_patch(np.asarray(shape.size, float), kind, parameters, count, rng)
        if kind != "triangle":
            p, m = apply(shape.pose, p), m @ rotation_matrix(shape.pose).T
        points.append(p)
        normals.append(m)
    return np.concatenate(points), np.concatenate(normals)
