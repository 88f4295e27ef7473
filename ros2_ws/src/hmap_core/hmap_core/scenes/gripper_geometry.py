"""Positions of a gripper's fingers at joint values, from the collision shapes of the URDF."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import meshes
from hmap_core.scenes.urdf import JointTree, attribute, child, joint_tree, mesh_path, numbers, origin
from hmap_core.transforms import to_matrix

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
        robot: root element of the URDF.
        file: path of the URDF, to which mesh paths are relative.
        end_effector: name of its link, and the end-effector frame (7,) in that link.
        finger_links: the links whose shapes count, one or more on each side of the plane y = 0 of the frame.

    Attributes:
        tree: the joints of the URDF.
    """

    def __init__(self, robot: Element, file: Path, end_effector: tuple[str, np.ndarray], finger_links: list[str]):
        self.tree: JointTree = joint_tree(robot)
        self._link, T = end_effector
        self._T_link_ee = to_matrix(T)
        self._file = file
        self._collisions = {link.get("name"): link.findall("collision") for link in robot.findall("link")}
        self._finger_links = finger_links

    @cached_property
    def _shapes(self) -> dict[str, list]:
        """For each finger link, the poses (4, 4) of its shapes in the link frame, with their support functions."""
        return {
            link: [
                (to_matrix(origin(c)), _support(self._file, child(c, "geometry")[0])) for c in self._collisions[link]
            ]
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


def _support(file: Path, geometry: Element) -> SupportFunction:
    """The support function of a shape in its own frame: direction (3,) -> m (van den Bergen 2003)."""
    if geometry.tag == "mesh":
        vertices = meshes.hull_vertices(mesh_path(file, attribute(geometry, "filename")))
        vertices = vertices * numbers(geometry.get("scale"), [1, 1, 1])
        return lambda d: float((vertices @ d).max())
    if geometry.tag == "box":
        half = 0.5 * numbers(geometry.get("size"), [])
        return lambda d: float(np.abs(d) @ half)
    radius = float(attribute(geometry, "radius"))
    if geometry.tag == "sphere":
        return lambda d: radius
    half_length = 0.5 * float(attribute(geometry, "length"))
    if geometry.tag == "cylinder":
        return lambda d: float(radius * np.hypot(d[0], d[1]) + half_length * abs(d[2]))
    return lambda d: float(radius + half_length * abs(d[2]))
