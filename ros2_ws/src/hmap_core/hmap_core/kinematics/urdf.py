"""The part of a URDF that planning needs: joints, and the collision geometry of each link as convex hulls."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from hmap_core.collision.convex import hull_vertices
from hmap_core.exceptions import Code, InputError
from hmap_core.transforms import IDENTITY, from_rpy
from hmap_core.types import Shape, ShapeKind

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfJoint:
    """A joint; ``T_parent_joint`` (7,) is its origin in the parent link, ``axis`` (3,) is in the joint frame."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray


@dataclass(frozen=True)
class Urdf:
    """Joints by child link, and hulls (vertices (n, 3), radius) by link, in the link frame."""

    joints: dict[str, UrdfJoint]
    hulls: dict[str, list[tuple[np.ndarray, float]]]

    def joint_path(self, link: str) -> list[UrdfJoint]:
        """Joints from the root to a link."""
        path = []
        while link in self.joints:
            path.append(self.joints[link])
            link = path[-1].parent
        return path[::-1]


def _numbers(text: str | None, default) -> np.ndarray:
    return np.array([float(v) for v in text.split()]) if text else np.array(default, float)


def _origin(element) -> np.ndarray:
    origin = element.find("origin")
    if origin is None:
        return IDENTITY
    return from_rpy(_numbers(origin.get("xyz"), [0, 0, 0]), _numbers(origin.get("rpy"), [0, 0, 0]))


def _mesh_path(file: Path, name: str) -> Path:
    for prefix in ("package://", "file://"):
        name = name.removeprefix(prefix)
    for base in (file.parent, *file.parents):
        if (base / name).exists():
            return base / name
    raise InputError(f"mesh '{name}' named in '{file}' does not exist", Code.INVALID_SCENE)


def _shape(file: Path, collision) -> Shape:
    geometry = collision.find("geometry")[0]
    pose = _origin(collision)
    if geometry.tag == "box":
        return Shape(ShapeKind.BOX, tuple(_numbers(geometry.get("size"), [])), pose)
    if geometry.tag == "sphere":
        return Shape(ShapeKind.SPHERE, (float(geometry.get("radius")),), pose)
    if geometry.tag in ("cylinder", "capsule"):
        return Shape(ShapeKind(geometry.tag), (float(geometry.get("radius")), float(geometry.get("length"))), pose)
    if geometry.tag == "mesh":
        scale = tuple(_numbers(geometry.get("scale"), [1, 1, 1]))
        return Shape(ShapeKind.MESH, scale, pose, _mesh_path(file, geometry.get("filename")))
    raise InputError(
        f"'{file}': collision geometry <{geometry.tag}> is not known; use box, sphere, cylinder, capsule or mesh",
        Code.INVALID_SCENE,
    )


@lru_cache(maxsize=16)
def load_urdf(file: Path) -> Urdf:
    """Reads a URDF.

    Raises:
        InputError: the file is missing, is not XML, or names geometry that is not known.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"URDF '{file}' cannot be read: {error}", Code.INVALID_SCENE) from error
    joints = {}
    for joint in root.findall("joint"):
        axis = joint.find("axis")
        direction = _numbers(axis.get("xyz") if axis is not None else None, [1, 0, 0])
        child = joint.find("child").get("link")
        joints[child] = UrdfJoint(
            joint.get("name"),
            joint.get("type"),
            joint.find("parent").get("link"),
            child,
            _origin(joint),
            direction / max(np.linalg.norm(direction), 1e-12),
        )
    hulls = {
        link.get("name"): [hull_vertices(_shape(file, c)) for c in link.findall("collision")]
        for link in root.findall("link")
    }
    return Urdf(joints, hulls)
