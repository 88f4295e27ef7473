"""Positions of a gripper's fingers at joint values, from the collision shapes of the URDF."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.robot_description import JointTree, RobotDescription
from hmap_core.scenes import meshes
from hmap_core.transforms import to_matrix
from hmap_core.types import Shape, ShapeKind

SupportFunction = Callable[[np.ndarray], float]


@dataclass(frozen=True)
class FingerPositions:
    """Positions of the fingers in the end-effector frame, m.

    Attributes:
        gap: distance between the fingers along y; negative in overlap.
        middle: y at the middle of the gap.
        tip: largest z of the fingers.
    """

    gap: float
    middle: float
    tip: float


class GripperGeometry:
    """The fingers of a gripper.

    Args:
        robot: the robot description.
        end_effector: name of its link, and the end-effector frame (7,) in that link.
        finger_links: the links whose shapes count, one or more on each side of the plane y = 0 of the frame.

    Attributes:
        tree: the joints of the URDF.
    """

    def __init__(self, robot: RobotDescription, end_effector: tuple[str, np.ndarray], finger_links: list[str]):
        self.tree: JointTree = robot.tree
        self._link, T = end_effector
        self._T_link_ee = to_matrix(T)
        self._links = robot.links
        self._finger_links = finger_links

    @cached_property
    def _shapes(self) -> dict[str, list]:
        """For each finger link, the poses (4, 4) of its shapes in the link frame, with their support functions."""
        return {
            link: [(to_matrix(shape.pose), _support(shape)) for shape in self._links[link].shapes]
            for link in self._finger_links
        }

    def at(self, values: Mapping[str, float]) -> FingerPositions:
        """Computes the positions of the fingers.

        Args:
            values: joint name -> value, rad or m; joints that mimic one of these follow it.

        Returns:
            The positions.

        Raises:
            InputError: INVALID_SCENE; one side of the plane y = 0 has no finger with a shape, or a mimicked joint is
                missing.
        """
        T_ee_root = np.linalg.inv(self.tree.pose(self._link, values) @ self._T_link_ee)
        sides: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
        tips = []
        for link, shapes in self._shapes.items():
            T_ee_link = T_ee_root @ self.tree.pose(link, values)
            placed = [(T_ee_link @ T, support) for T, support in shapes]
            if not placed:
                continue
            lower = min(-_farthest(T, support, (0.0, -1.0, 0.0)) for T, support in placed)
            upper = max(_farthest(T, support, (0.0, 1.0, 0.0)) for T, support in placed)
            tips += [_farthest(T, support, (0.0, 0.0, 1.0)) for T, support in placed]
            sides[lower + upper > 0.0].append((lower, upper))
        if not all(sides.values()):
            raise InputError(
                "have no shape on one side of the end-effector frame's y = 0, which has to be midway between them",
                Code.INVALID_SCENE,
            )
        left, right = min(lower for lower, _ in sides[True]), max(upper for _, upper in sides[False])
        return FingerPositions(left - right, 0.5 * (left + right), max(tips))


def _farthest(T: np.ndarray, support: SupportFunction, direction: tuple[float, float, float]) -> float:
    """Largest coordinate of a shape at T (4, 4) along a direction (3,), m."""
    d = np.array(direction)
    return float(T[:3, 3] @ d + support(T[:3, :3].T @ d))


def _support(shape: Shape) -> SupportFunction:
    """The support function of a shape in its own frame: direction (3,) -> m (van den Bergen 2003)."""
    if shape.mesh is not None:
        vertices = meshes.hull_vertices(shape.mesh) * np.array(shape.size)
        return lambda d: float((vertices @ d).max())
    if shape.kind is ShapeKind.BOX:
        half = 0.5 * np.array(shape.size)
        return lambda d: float(np.abs(d) @ half)
    radius = shape.size[0]
    if shape.kind is ShapeKind.SPHERE:
        return lambda d: radius
    half_length = 0.5 * shape.size[1]
    if shape.kind is ShapeKind.CYLINDER:
        return lambda d: float(radius * np.hypot(d[0], d[1]) + half_length * abs(d[2]))
    return lambda d: float(radius + half_length * abs(d[2]))
