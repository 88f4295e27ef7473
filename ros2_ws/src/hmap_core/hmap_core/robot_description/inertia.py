"""Masses and inertias of links, for the simulation."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.mesh_files import read_hull
from hmap_core.robot_description.joints import read_origin
from hmap_core.robot_description.node import Node
from hmap_core.transforms import IDENTITY, apply, pose, rotation_matrix
from hmap_core.types import Shape, ShapeKind

DENSITY = 1000.0  # kg/m^3, assumed for the hulls of links without mass; arms of known mass have 700 to 1500
FRAME_MASS = 1e-3  # kg, of a link without mass and shape
FRAME_RADIUS = 0.03  # m, radius of gyration of such a link: without inertia the joints before it would be singular
TRIANGLE = 1.0 + 1e-3  # largest moment of inertia relative to the sum of the others
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True)
class Inertial:
    """Mass properties of a link.

    Attributes:
        mass: kg.
        T_link_com: (7,) frame at the centre of mass, in the link frame.
        inertia: (3, 3) tensor about the centre of mass, in that frame, kg m^2.
    """

    mass: float
    T_link_com: np.ndarray
    inertia: np.ndarray


def read_inertial(node: Node, shapes: tuple[Shape, ...], quiet: bool) -> Inertial:
    """Reads the mass properties of a link, or assumes them where it has none.

    A link without mass is a frame if it has no shape, and else weighs what its shapes do at :data:`DENSITY`.

    Args:
        node: the link.
        shapes: its collision shapes.
        quiet: whether to give no warnings, since the link does not move.

    Returns:
        The mass properties.
    """
    element = node.child("inertial")
    mass_element = element.child("mass") if element is not None else None
    mass = mass_element.number("value") if mass_element is not None else 0.0
    if mass is not None and mass < 0.0 and mass_element is not None:
        mass_element.error(f'value="{mass:g}" is negative')
    if element is None or not mass or mass < 0.0:
        found = assumed_inertial(shapes)
        if shapes and not quiet:
            node.warn(f"has no mass; {found.mass:.3g} kg are assumed in the simulation, of the volume of its shapes")
        return found
    T = read_origin(element)
    tensor = _tensor(element)
    if tensor is None:
        guess = assumed_inertial(shapes)
        if not quiet:
            element.warn("has no <inertia> that a body can have; that of a box as large as its shapes is assumed")
        tensor = guess.inertia * (mass / guess.mass)
        R = rotation_matrix(T)
        tensor = R.T @ tensor @ R
    return Inertial(mass, T, tensor)


def _tensor(element: Node) -> np.ndarray | None:
    """The inertia tensor (3, 3); None if there is none, or no body can have it."""
    inertia = element.child("inertia")
    if inertia is None:
        return None
    numbers = [inertia.number(key, 0.0) for key in MOMENTS]
    if None in numbers:
        return np.eye(3)  # an error is recorded
    xx, xy, xz, yy, yz, zz = (number or 0.0 for number in numbers)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments = np.linalg.eigvalsh(tensor)
    return tensor if moments[0] > 0.0 and moments[2] <= TRIANGLE * (moments[0] + moments[1]) else None


def assumed_inertial(shapes: tuple[Shape, ...]) -> Inertial:
    """Mass properties of a link that has none: those of a box round its shapes, with their mass at :data:`DENSITY`."""
    if not shapes:
        return Inertial(FRAME_MASS, IDENTITY, np.eye(3) * FRAME_MASS * FRAME_RADIUS**2)
    bounds = [_bounds(shape) for shape in shapes]
    low, high = np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
    mass = max(DENSITY * sum(_volume(shape) for shape in shapes), FRAME_MASS)
    squares = (high - low) ** 2
    inertia = np.diag(np.maximum(mass / 12.0 * (squares.sum() - squares), FRAME_MASS * FRAME_RADIUS**2))
    return Inertial(mass, pose((low + high) / 2.0), inertia)


def _volume(shape: Shape) -> float:
    size = np.array(shape.size)
    if shape.mesh is not None:
        return float(ConvexHull(read_hull(shape.mesh).vertices).volume * abs(size.prod()))
    if shape.kind is ShapeKind.BOX:
        return float(size.prod())
    if shape.kind is ShapeKind.SPHERE:
        return float(4.0 / 3.0 * np.pi * size[0] ** 3)
    ball = 4.0 / 3.0 * np.pi * size[0] ** 3 if shape.kind is ShapeKind.CAPSULE else 0.0
    return float(np.pi * size[0] ** 2 * size[1] + ball)


def _bounds(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (3,) of a box round a shape, in the link frame."""
    if shape.mesh is not None:
        points = read_hull(shape.mesh).vertices * np.array(shape.size)
    else:
        half = _half_extents(shape)
        points = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
    placed = apply(shape.pose, points)
    return placed.min(axis=0), placed.max(axis=0)


def _half_extents(shape: Shape) -> np.ndarray:
    if shape.kind is ShapeKind.BOX:
        return np.array(shape.size) / 2.0
    radius = shape.size[0]
    if shape.kind is ShapeKind.SPHERE:
        return np.full(3, radius)
    length = shape.size[1] / 2.0 + (radius if shape.kind is ShapeKind.CAPSULE else 0.0)
    return np.array([radius, radius, length])
