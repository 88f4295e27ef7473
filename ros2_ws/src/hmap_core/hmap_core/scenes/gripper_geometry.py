"""Where the fingers of a gripper are at values of its joints, from the shapes in the URDF."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import meshes
from hmap_core.scenes.urdf import JointTree, joint_tree, mesh_path, numbers, origin
from hmap_core.transforms import to_matrix


@dataclass(frozen=True)
class FingerPlaces:
    """Where fingers are in the end-effector frame, m.

    Attributes:
        gap: between the fingers, along y; negative where they overlap.
        middle: y in the middle of the gap.
        tip: how far along z they reach.
    """

    gap: float
    middle: float
    tip: float


class GripperGeometry:
    """The fingers of a gripper.

    Args:
        robot: root element of the URDF.
        file: where that is, since meshes are looked for from there.
        end_effector: its link, and the end-effector frame (7,) in it.
        finger_links: the links whose shapes count, one or more on each side of the frame's y = 0.
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
        """Of each finger link: where its shapes are in it (4, 4), and their support functions."""
        return {
            link: [(to_matrix(origin(c)), _support(self._file, c.find("geometry")[0])) for c in self._collisions[link]]
            for link in self._finger_links
        }

    def at(self, values: Mapping[str, float]) -> FingerPlaces:
        """Where the fingers are with joints at values (rad or m); joints that mimic one of these follow.

        Raises:
            InputError: INVALID_SCENE; not on both sides of y = 0 is a finger with a shape.
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
        return FingerPlaces(left - right, 0.5 * (left + right), max(tips))


def _farthest(T: np.ndarray, support, direction) -> float:
    """How far a shape at T (4, 4) reaches along a direction (3,), m."""
    direction = np.array(direction)
    return float(T[:3, 3] @ direction + support(T[:3, :3].T @ direction))


def _support(file: Path, geometry: Element):
    """The support function of a shape in its own frame: direction (3,) -> m."""
    if geometry.tag == "mesh":
        vertices = meshes.hull_vertices(mesh_path(file, geometry.get("filename")))
        vertices = vertices * numbers(geometry.get("scale"), [1, 1, 1])
        return lambda d: (vertices @ d).max()
    if geometry.tag == "box":
        half = 0.5 * numbers(geometry.get("size"), [])
        return lambda d: np.abs(d) @ half
    radius = float(geometry.get("radius"))
    if geometry.tag == "sphere":
        return lambda d: radius
    half_length = 0.5 * float(geometry.get("length"))
    if geometry.tag == "cylinder":
        return lambda d: radius * np.hypot(d[0], d[1]) + half_length * abs(d[2])
    return lambda d: radius + half_length * abs(d[2])
