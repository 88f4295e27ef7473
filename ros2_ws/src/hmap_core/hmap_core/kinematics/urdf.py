"""Joints of a URDF, and the collision geometry of its links as convex hulls."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from hmap_core.collision.convex import hull_vertices
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes.urdf import JointTree, attribute, child, joint_tree, mesh_path, numbers, origin
from hmap_core.types import Shape, ShapeKind


@dataclass(frozen=True)
class Urdf:
    """A robot description.

    Attributes:
        tree: the joints.
        hulls: link name -> convex hulls in the link frame, as vertices (n, 3) with the radius of the sweeping sphere,
            m.
    """

    tree: JointTree
    hulls: dict[str, list[tuple[np.ndarray, float]]]


def _shape(file: Path, collision: ElementTree.Element) -> Shape:
    geometry = child(collision, "geometry")[0]
    pose = origin(collision)
    if geometry.tag == "box":
        return Shape(ShapeKind.BOX, tuple(numbers(geometry.get("size"), [])), pose)
    if geometry.tag == "sphere":
        return Shape(ShapeKind.SPHERE, (float(attribute(geometry, "radius")),), pose)
    if geometry.tag in ("cylinder", "capsule"):
        size = float(attribute(geometry, "radius")), float(attribute(geometry, "length"))
        return Shape(ShapeKind(geometry.tag), size, pose)
    if geometry.tag == "mesh":
        scale = tuple(numbers(geometry.get("scale"), [1, 1, 1]))
        return Shape(ShapeKind.MESH, scale, pose, mesh_path(file, attribute(geometry, "filename")))
    raise InputError(
        f"'{file}': collision geometry <{geometry.tag}> is not known; use box, sphere, cylinder, capsule or mesh",
        Code.INVALID_SCENE,
    )


@lru_cache(maxsize=16)
def load_urdf(file: Path) -> Urdf:
    """Reads a URDF.

    Args:
        file: its path.

    Returns:
        The robot description, from a cache.

    Raises:
        InputError: INVALID_SCENE; the file is missing, is no XML, or contains unknown geometry.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"URDF '{file}' cannot be read: {error}", Code.INVALID_SCENE) from error
    hulls = {
        attribute(link, "name"): [hull_vertices(_shape(file, c)) for c in link.findall("collision")]
        for link in root.findall("link")
    }
    return Urdf(joint_tree(root), hulls)
