"""Boxes, and distances between them from an independent library (coal)."""

import coal
import numpy as np

from hmap_core.transforms import IDENTITY, apply, distance, interpolate, multiply, pose, to_matrix
from hmap_core.types import Body, BodyKind, Shape, ShapeKind


def box(name, size, position, quaternion=(0.0, 0.0, 0.0, 1.0), kind=BodyKind.FIXED, **more) -> Body:
    return Body(name, kind, (Shape(ShapeKind.BOX, tuple(size)),), pose(position, quaternion), **more)


def yaw(angle):
    return (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))


TABLE = box("table", (4.0, 4.0, 0.1), (0.0, 0.0, 0.0))  # its top at z = 0.05


def coal_shape(shape: Shape):
    if shape.kind == ShapeKind.BOX:
        return coal.Box(*shape.size)
    if shape.kind == ShapeKind.SPHERE:
        return coal.Sphere(*shape.size)
    if shape.kind == ShapeKind.CYLINDER:
        return coal.Cylinder(*shape.size)
    if shape.kind == ShapeKind.CAPSULE:
        return coal.Capsule(*shape.size)
    raise NotImplementedError(shape.kind)


def coal_hull(points):
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(np.asarray(points, float)))
    return coal.ConvexBase.convexHull(vertices, True, "Qt")


def coal_transform(T):
    matrix = to_matrix(np.asarray(T))
    return coal.Transform3s(np.ascontiguousarray(matrix[:3, :3]), matrix[:3, 3].copy())


def coal_distance(a, T_a, b, T_b) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return coal.distance(a, coal_transform(T_a), b, coal_transform(T_b), request, result)


def body_distances(body: Body, T, obstacles) -> dict[str, float]:
    """Signed distance of a body at a pose from each obstacle at its own pose."""
    out = {}
    for other in obstacles:
        out[other.name] = min(
            coal_distance(coal_shape(s), multiply(T, s.pose), coal_shape(o), multiply(other.pose, o.pose))
            for s in body.shapes
            for o in other.shapes
        )
    return out


def dense(path, step=2e-3, radius=0.5):
    """Poses on the path so near to each other that no point of the body moves more than about ``step``."""
    out = [path[0]]
    for a, b in zip(path[:-1], path[1:], strict=True):
        d, angle = distance(a, b)
        n = max(int(np.ceil((d + radius * angle) / step)), 1)
        out += list(interpolate(a, b, np.arange(1, n + 1) / n))
    return out


def worst_distance(body: Body, path, obstacles, step=2e-3, radius=0.5) -> float:
    return min(min(body_distances(body, T, obstacles).values()) for T in dense(path, step, radius))


__all__ = ["IDENTITY", "TABLE", "apply", "body_distances", "box", "coal_distance", "coal_hull", "coal_shape", "dense",
           "worst_distance", "yaw"]  # fmt: skip
