"""The joints of a URDF, which of them follow another one, where all of them put the links, and where meshes are."""

from collections.abc import Mapping
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
        T_parent_joint: (7,) its origin in the parent link.
        axis: (3,) in the joint frame, unit.
        lower, upper, velocity: rad or m, and per s; infinite where the URDF does not say.
        mimic: the joint that it follows, by how much for one of that one's, and its value at that one's zero.
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
        """The child link's frame in the joint frame at a value (rad or m), (4, 4)."""
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
    """The joints of a URDF, by the link that each carries."""

    by_child: dict[str, UrdfJoint]
    by_name: dict[str, UrdfJoint] = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "by_name", {joint.name: joint for joint in self.by_child.values()})

    def path(self, link: str) -> list[UrdfJoint]:
        """Joints from the root to a link."""
        path = []
        while link in self.by_child:
            path.append(self.by_child[link])
            link = path[-1].parent
        return path[::-1]

    def driver(self, name: str) -> tuple[str, float, float]:
        """The joint that a joint follows in the end, the factor, and the value at that one's zero; itself if none.

        Raises:
            InputError: INVALID_SCENE; it follows a joint that is not there, or itself.
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

    def followers(self, name: str) -> dict[str, tuple[float, float]]:
        """Joints that follow a joint: name -> factor, and value at that one's zero."""
        found = {}
        for other in self.by_name:
            driver, factor, offset = self.driver(other)
            if driver == name and other != name:
                found[other] = factor, offset
        return found

    def pose(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """A link's frame in the root's, (4, 4); joints with no value and none to follow are at 0."""
        T = np.eye(4)
        for joint in self.path(link):
            name, factor, offset = self.driver(joint.name)
            value = values.get(joint.name, factor * values.get(name, 0.0) + offset)
            T = T @ to_matrix(joint.T_parent_joint) @ joint.motion(value)
        return T


def mesh_path(file: Path, name: str) -> Path:
    """Where the mesh is that a URDF calls ``name``: in its folder or one above, as PyBullet looks for it.

    Raises:
        InputError: INVALID_SCENE; there is none.
    """
    for prefix in ("package://", "file://"):
        name = name.removeprefix(prefix)
    for base in (file.parent, *file.parents):
        if (base / name).exists():
            return base / name
    raise InputError(f"mesh '{name}' named in '{file}' does not exist", Code.INVALID_SCENE)


def numbers(text: str | None, default) -> np.ndarray:
    """The numbers of an attribute, or the default where it is missing."""
    return np.array([float(v) for v in text.split()]) if text else np.array(default, float)


def origin(element: Element) -> np.ndarray:
    """The pose (7,) in an element's ``origin``."""
    found = element.find("origin")
    if found is None:
        return IDENTITY
    return from_rpy(numbers(found.get("xyz"), [0, 0, 0]), numbers(found.get("rpy"), [0, 0, 0]))


def joint_tree(robot: Element) -> JointTree:
    """The joints of a URDF's root element."""
    joints = [_joint(element) for element in robot.findall("joint") if element.find("child") is not None]
    return JointTree({joint.child: joint for joint in joints})


def _joint(element: Element) -> UrdfJoint:
    axis, limit, mimic = (element.find(key) for key in ("axis", "limit", "mimic"))
    direction = numbers(axis.get("xyz") if axis is not None else None, [1, 0, 0])
    bounded = limit is not None and element.get("type") in ("revolute", "prismatic")
    return UrdfJoint(
        element.get("name"),
        element.get("type"),
        element.find("parent").get("link"),
        element.find("child").get("link"),
        origin(element),
        direction / max(np.linalg.norm(direction), 1e-12),
        float(limit.get("lower", 0.0)) if bounded else -np.inf,
        float(limit.get("upper", 0.0)) if bounded else np.inf,
        float(limit.get("velocity", np.inf)) if limit is not None else np.inf,
        None
        if mimic is None
        else (mimic.get("joint"), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))),
    )
