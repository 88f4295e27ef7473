"""Rigid bodies of the scene as PyBullet bodies: shapes, mass properties, friction, colour."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pybullet
import trimesh
from scipy.spatial.transform import Rotation

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_hull
from hmap_core.simulation.client import BulletClient
from hmap_core.types import Body, BodyKind, Shape, ShapeKind

# rgba, where a body names no colour
COLORS = {
    BodyKind.FIXED: (0.72, 0.72, 0.74, 1.0),
    BodyKind.MOVABLE: (0.20, 0.45, 0.80, 1.0),
    BodyKind.TOOL: (0.85, 0.60, 0.20, 1.0),
}
ROUND = (ShapeKind.CYLINDER, ShapeKind.SPHERE, ShapeKind.CAPSULE)
END = 2e-4  # m by which the ends of a cylinder lie behind the boxes that it stands on, and these inside its side
ROLLING_FRICTION = 1e-4  # m, of bodies with round parts; without it they roll away from rest by rounding errors
DIAGONAL_TOLERANCE = 1e-9  # share of the largest moment; smaller products of inertia count as zero


@dataclass(frozen=True)
class BodyHandle:
    """A body in the physics server; PyBullet speaks of its inertial frame, we of its body frame."""

    id: int
    body: Body
    T_body_inertial: np.ndarray  # (7,)


def create(client: BulletClient, body: Body, mesh_directory: Path) -> BodyHandle:
    """Put a body at its pose, at rest.

    Args:
        mesh_directory: where convex hulls of meshes are written for PyBullet to read.

    Raises:
        InputError: a movable body without mass, or PyBullet refuses the shapes.
    """
    fixed = body.kind is BodyKind.FIXED
    if not fixed and not body.mass > 0.0:
        raise InputError(f"body '{body.name}' is {body.kind} and has mass {body.mass} kg; it has to be positive")
    T_body_inertial, moments = (transforms.IDENTITY, None) if fixed else mass_properties(body.shapes, body.mass)
    collision, visual = _shape_arrays(client, body, mesh_directory)
    identifier = client.createMultiBody(
        0.0 if fixed else body.mass,
        collision,
        visual,
        body.pose[:3].tolist(),
        body.pose[3:].tolist(),
        T_body_inertial[:3].tolist(),
        T_body_inertial[3:].tolist(),
    )
    rolling = ROLLING_FRICTION if any(shape.kind in ROUND for shape in body.shapes) else 0.0
    client.changeDynamics(identifier, -1, lateralFriction=body.friction, spinningFriction=0.0, rollingFriction=rolling)
    if moments is not None:
        client.changeDynamics(identifier, -1, localInertiaDiagonal=moments.tolist())
    client.changeVisualShape(identifier, -1, rgbaColor=body.color or COLORS[body.kind])
    return BodyHandle(identifier, body, T_body_inertial)


def pose_of(client: BulletClient, handle: BodyHandle) -> np.ndarray:
    """``T_world_body`` (7,) at present."""
    position, quaternion = client.getBasePositionAndOrientation(handle.id)
    T_world_inertial = np.array([*position, *quaternion])
    return transforms.multiply(T_world_inertial, transforms.inverse(handle.T_body_inertial))


def place(client: BulletClient, handle: BodyHandle, T_world_body: np.ndarray) -> None:
    """Put a body somewhere else, at rest."""
    T_world_inertial = transforms.multiply(T_world_body, handle.T_body_inertial)
    client.resetBasePositionAndOrientation(handle.id, T_world_inertial[:3].tolist(), T_world_inertial[3:].tolist())
    client.resetBaseVelocity(handle.id, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])


def velocity_of(client: BulletClient, handle: BodyHandle) -> np.ndarray:
    """Velocity (6,) of the body frame's origin (m/s) and angular velocity (rad/s), world axes."""
    linear, angular = client.getBaseVelocity(handle.id)
    T_world_body = pose_of(client, handle)
    lever = -transforms.rotation_matrix(T_world_body) @ handle.T_body_inertial[:3]
    return np.concatenate([np.array(linear) + np.cross(angular, lever), angular])


def mass_properties(shapes: tuple[Shape, ...], mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass and principal moments of shapes of one density.

    Where shapes overlap, what they share counts twice.

    Returns:
        ``T_body_inertial`` (7,): origin at the centre of mass, axes principal; moments (3,) about them, kg m^2.
    """
    volumes, centers, tensors = zip(*map(_volume_properties, shapes), strict=True)
    weights = mass * np.array(volumes) / sum(volumes)
    center = weights @ np.array(centers) / mass
    total = np.zeros((3, 3))
    for weight, c, tensor in zip(weights, centers, tensors, strict=True):
        d = c - center
        total += weight * (tensor + d @ d * np.eye(3) - np.outer(d, d))  # parallel axes
    if np.abs(total - np.diag(np.diag(total))).max() <= DIAGONAL_TOLERANCE * total.max():
        return transforms.pose(center), np.diag(total).copy()
    moments, axes = np.linalg.eigh(total)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return transforms.pose(center, Rotation.from_matrix(axes).as_quat()), moments


def _volume_properties(shape: Shape) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume, centre (3,) and inertia per mass (3, 3) about the centre, in the body frame."""
    volume: float
    if shape.kind is ShapeKind.MESH:
        hull = convex_hull(shape)
        volume, center, tensor = hull.volume, np.array(hull.center_mass), hull.moment_inertia / hull.mass
    else:
        volume, moments = _PRIMITIVES[shape.kind](*shape.size)
        center, tensor = np.zeros(3), np.diag(moments)
    R = transforms.rotation_matrix(shape.pose)
    return volume, transforms.apply(shape.pose, center), R @ tensor @ R.T


def _box(x: float, y: float, z: float) -> tuple[float, np.ndarray]:
    return x * y * z, np.array([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0


def _sphere(r: float) -> tuple[float, np.ndarray]:
    return 4.0 / 3.0 * np.pi * r**3, np.full(3, 0.4 * r * r)


def _cylinder(r: float, h: float) -> tuple[float, np.ndarray]:
    across = (3.0 * r * r + h * h) / 12.0
    return np.pi * r * r * h, np.array([across, across, 0.5 * r * r])


def _capsule(r: float, h: float) -> tuple[float, np.ndarray]:
    tube, (tube_across, _, tube_along) = _cylinder(r, h)
    ball, (ball_about, _, _) = _sphere(r)
    # each half ball's centre of mass lies 3/8 r beyond the end of the tube
    ball_across = ball_about + h * h / 4.0 + 3.0 / 8.0 * h * r
    volume = tube + ball
    across = (tube * tube_across + ball * ball_across) / volume
    return volume, np.array([across, across, (tube * tube_along + ball * ball_about) / volume])


_PRIMITIVES: dict[ShapeKind, Callable[..., tuple[float, np.ndarray]]] = {
    ShapeKind.BOX: _box,
    ShapeKind.SPHERE: _sphere,
    ShapeKind.CYLINDER: _cylinder,
    ShapeKind.CAPSULE: _capsule,
}


def convex_hull(shape: Shape) -> trimesh.Trimesh:
    """The convex hull of a mesh shape, scaled, in the shape's frame.

    Raises:
        InputError: the file is missing, is no mesh, or spans no volume.
    """
    if shape.mesh is None:
        raise InputError("a mesh shape has no file")
    return trimesh.PointCloud(read_hull(shape.mesh).vertices * np.array(shape.size)).convex_hull


def _shape_arrays(client: BulletClient, body: Body, mesh_directory: Path) -> tuple[int, int]:
    """Ids of the collision and of the visual shape of a body."""
    files = [mesh_directory / f"{body.name}_{i}.obj" for i in range(len(body.shapes))]
    positions = [s.pose[:3].tolist() for s in body.shapes]
    quaternions = [s.pose[3:].tolist() for s in body.shapes]
    fixed = body.kind is BodyKind.FIXED
    solid = [(own, file) for s, file in zip(body.shapes, files, strict=True) for own in ([s] if fixed else _on_ends(s))]
    try:
        collision = client.createCollisionShapeArray(
            **_columns(_collision_entry(shape, file) for shape, file in solid),
            collisionFramePositions=[s.pose[:3].tolist() for s, _ in solid],
            collisionFrameOrientations=[s.pose[3:].tolist() for s, _ in solid],
        )
        visual = client.createVisualShapeArray(
            **_columns(map(_visual_entry, body.shapes, files)),
            visualFramePositions=positions,
            visualFrameOrientations=quaternions,
        )
    except pybullet.error as error:
        raise InputError(f"body '{body.name}': PyBullet cannot make its shapes: {error}") from error
    return collision, visual


def _on_ends(shape: Shape) -> list[Shape]:
    """A shape as it collides: a cylinder stands on the corners of boxes inside it, which Bullet keeps at rest."""
    if shape.kind is not ShapeKind.CYLINDER or 2.0 * END > shape.size[1]:
        return [shape]
    radius, height = shape.size
    side = np.sqrt(2.0) * (radius - END)
    boxes = [
        Shape(ShapeKind.BOX, (side, side, height), transforms.multiply(shape.pose, transforms.pose((0, 0, 0), turn)))
        for turn in ((0.0, 0.0, np.sin(angle), np.cos(angle)) for angle in (0.0, np.pi / 8.0))
    ]
    return [replace(shape, size=(radius, height - 2.0 * END)), *boxes]


def _columns(entries: Iterable[dict]) -> dict[str, list]:
    entries = list(entries)
    return {key: [entry[key] for entry in entries] for key in entries[0]}


def _collision_entry(shape: Shape, mesh_file: Path) -> dict:
    """One entry of each of PyBullet's shape arrays."""
    entry = {
        "shapeTypes": pybullet.GEOM_BOX,
        "halfExtents": [0.0, 0.0, 0.0],
        "radii": 0.0,
        "lengths": 0.0,
        "fileNames": "",
        "meshScales": [1.0, 1.0, 1.0],
    }
    if shape.kind is ShapeKind.BOX:
        entry["halfExtents"] = [0.5 * extent for extent in shape.size]
    elif shape.kind is ShapeKind.SPHERE:
        entry |= {"shapeTypes": pybullet.GEOM_SPHERE, "radii": shape.size[0]}
    elif shape.kind is ShapeKind.MESH:
        convex_hull(shape).export(mesh_file)
        entry |= {"shapeTypes": pybullet.GEOM_MESH, "fileNames": str(mesh_file)}
    else:
        kind = pybullet.GEOM_CYLINDER if shape.kind is ShapeKind.CYLINDER else pybullet.GEOM_CAPSULE
        entry |= {"shapeTypes": kind, "radii": shape.size[0], "lengths": shape.size[1]}
    return entry


def _visual_entry(shape: Shape, mesh_file: Path) -> dict:
    """The same for what cameras see: PyBullet draws round shapes with few faces, so they are drawn as fine meshes."""
    if shape.kind not in _ROUND:
        return _collision_entry(shape, mesh_file)
    mesh = _ROUND[shape.kind](*shape.size)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.export(mesh_file)
    blank = _collision_entry(Shape(ShapeKind.BOX, (0.0, 0.0, 0.0)), mesh_file)
    return blank | {"shapeTypes": pybullet.GEOM_MESH, "fileNames": str(mesh_file)}


_ROUND: dict[ShapeKind, Callable[..., trimesh.Trimesh]] = {
    ShapeKind.SPHERE: lambda r: trimesh.creation.icosphere(subdivisions=3, radius=r),
    ShapeKind.CYLINDER: lambda r, h: trimesh.creation.cylinder(radius=r, height=h, sections=64),
    ShapeKind.CAPSULE: lambda r, h: trimesh.creation.capsule(radius=r, height=h, count=(32, 32)),
}
