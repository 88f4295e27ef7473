"""Joints of a robot description, and the collision geometry of its links as convex hulls."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from hmap_core.collision.convex import hull_vertices
from hmap_core.robot_description import JointTree, RobotDescription, load_robot_description


@dataclass(frozen=True)
class Urdf:
    """The part of a robot description that the kinematics need.

    Attributes:
        tree: the joints.
        hulls: link name -> convex hulls in the link frame, as vertices (n, 3) with the radius of the sweeping sphere,
            m.
    """

    tree: JointTree
    hulls: dict[str, list[tuple[np.ndarray, float]]]


def load_urdf(file: Path) -> Urdf:
    """Reads a robot description.

    Args:
        file: its path.

    Returns:
        The joints and hulls, from a cache.

    Raises:
        InputError: INVALID_SCENE; the description has errors, or a mesh spans no volume.
    """
    return _with_hulls(load_robot_description(file).require_valid())


@lru_cache(maxsize=16)
def _with_hulls(description: RobotDescription) -> Urdf:
    hulls = {name: [hull_vertices(shape) for shape in link.shapes] for name, link in description.links.items()}
    return Urdf(description.tree, hulls)
