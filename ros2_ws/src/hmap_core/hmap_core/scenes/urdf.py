"""Joints of a URDF: kinematic tree, mimic joints, link frames, and paths of meshes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.transforms import IDENTITY, from_rpy, to_matrix

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfJoint:
    """A joint.

    Attributes:
        name, kind, parent, child: as in the URDF.
        T_parent_joint: (7,) joint frame in the parent link.
        axis: (3,) unit vector, joint frame.
        lower, upper, velocity: limits, rad or m, and per s; infinite if the URDF has none.
        mimic: driving joint, multiplier and offset; None for an independent joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    mimic: tuple[str, float, float] | None = None

    def motion(self, value: float) -> np.ndarray:
        """Transform (4, 4) of the child link in the joint frame at a value (rad or m)."""
        T = np.eye(4)
        if self.kind == "prismatic":
            T[:3, 3] = value * self.axis
        elif self.kind in MOVING:
            x, y, z = self.axis
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            T[:3, :3] += np.sin(value) * K + (1.0 - np.cos(value)) * K @ K
        return T


@dataclass(frozen=True)
class JointTree:
    """The joints of a URDF, by child link and by name."""

    by_child: dict[str, UrdfJoint]
    by_name: dict[str, UrdfJoint] = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "by_name", {joint.name: joint for joint in self.by_child.values()})

    def path(self, link: str) -> list[UrdfJoint]:
        """The joints from the root to a link."""
        path = []
        while link in self.by_child:
            path.append(self.by_child[link])
            link = path[-1].parent
        return path[::-1]

    def driver(self, name: str) -> tuple[str, float, float]:
        """Resolves the mimic relations of a joint.

        Args:
            name: of the joint.

        Returns:
            The independent joint that drives it, the multiplier and the offset; itself, 1 and 0 if it is independent.

        Raises:
            InputError: INVALID_SCENE; it mimics a joint that does not exist, or itself.
        """
        factor, offset, seen = 1.0, 0.0, [name]
        while (joint := self.by_name[name]).mimic is not None:
            name, multiplier, constant = joint.mimic
            if name not in self.by_name or name in seen:
                problem = "is not in the URDF" if name not in self.by_name else "follows it in turn"
                raise InputError(f"joint '{joint.name}' mimics '{name}', which {problem}", Code.INVALID_SCENE)
            factor, offset = factor * multiplier, offset + factor * constant
            seen.append(name)
        return name, factor, offset

    def mimics(self, name: str) -> dict[str, tuple[float, float]]:
        """The joints that mimic a joint, directly or through others.

        Args:
            name: of the driving joint.

        Returns:
            Joint name -> multiplier and offset.

        Raises:
            InputError: INVALID_SCENE; a joint mimics one that does not exist, or itself.
        """
        found = {}
        for other in self.by_name:
            driver, factor, offset = self.driver(other)
            if driver == name and other != name:
                found[other] = factor, offset
        return found

    def pose(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """Pose of a link in the root frame.

        Args:
            link: the link.
            values: joint name -> value, rad or m; other joints follow the joint that they mimic, or are at 0.

        Returns:
            (4, 4).

        Raises:
            InputError: INVALID_SCENE; a joint mimics one that does not exist, or itself.
        """
        T = np.eye(4)
        for joint in self.path(link):
            name, factor, offset = self.driver(joint.name)
            value = values.get(joint.name, factor * values.get(name, 0.0) + offset)
            T = T @ to_matrix(joint.T_parent_joint) @ joint.motion(value)
        return T


def mesh_path(file: Path, name: str) -> Path:
    """Path of a mesh that a URDF names, relative to the URDF's folder or one above it, as in PyBullet.

    Args:
        file: the URDF.
        name: as in the URDF.

    Raises:
        InputError: INVALID_SCENE; the file does not exist.
    """
    for prefix in ("package://", "file://"):
        name = name.removeprefix(prefix)
    for base in (file.parent, *file.parents):
        if (base / name).exists():
            return base / name
    raise InputError(f"mesh '{name}' named in '{file}' does not exist", Code.INVALID_SCENE)


def numbers(text: str | None, default: Sequence[float]) -> np.ndarray:
    """The numbers of an XML attribute; the default if it is missing.

    Args:
        text: the attribute, numbers separated by spaces.
        default: numbers.

    Returns:
        (n,) float.
    """
    return np.array([float(v) for v in text.split()]) if text else np.array(default, float)


def attribute(element: Element, key: str) -> str:
    """An attribute that an XML element must have.

    Raises:
        InputError: INVALID_SCENE; it is missing.
    """
    value = element.get(key)
    if value is None:
        raise InputError(f"a <{element.tag}> of the URDF has no attribute '{key}'", Code.INVALID_SCENE)
    return value


def child(element: Element, tag: str) -> Element:
    """The first child with a tag, which an XML element must have.

    Raises:
        InputError: INVALID_SCENE; it is missing.
    """
    found = element.find(tag)
    if found is None:
        name = element.get("name")
        where = f"<{element.tag}>" if name is None else f"<{element.tag}> '{name}'"
        raise InputError(f"a {where} of the URDF has no <{tag}>", Code.INVALID_SCENE)
    return found


def origin(element: Element) -> np.ndarray:
    """The pose (7,) in the ``origin`` element of an XML element; the identity if it has none."""
    found = element.find("origin")
    if found is None:
        return IDENTITY
    return from_rpy(numbers(found.get("xyz"), [0, 0, 0]), numbers(found.get("rpy"), [0, 0, 0]))


def joint_tree(robot: Element) -> JointTree:
    """The joints of a URDF, given its root element."""
    joints = [_joint(element) for element in robot.findall("joint") if element.find("child") is not None]
    return JointTree({joint.child: joint for joint in joints})


def _joint(element: Element) -> UrdfJoint:
    axis, limit, mimic = (element.find(key) for key in ("axis", "limit", "mimic"))
    direction = numbers(axis.get("xyz") if axis is not None else None, [1, 0, 0])
    bounds = limit if element.get("type") in ("revolute", "prismatic") else None
    return UrdfJoint(
        attribute(element, "name"),
        attribute(element, "type"),
        attribute(child(element, "parent"), "link"),
        attribute(child(element, "child"), "link"),
        origin(element),
        direction / max(np.linalg.norm(direction), 1e-12),
        float(bounds.get("lower", 0.0)) if bounds is not None else -np.inf,
        float(bounds.get("upper", 0.0)) if bounds is not None else np.inf,
        float(limit.get("velocity", np.inf)) if limit is not None else np.inf,
        None
        if mimic is None
        else (attribute(mimic, "joint"), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))),
    )
