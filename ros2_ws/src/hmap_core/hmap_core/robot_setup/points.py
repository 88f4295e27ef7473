"""Points of the links' collision shapes at joint values."""

from collections.abc import Mapping

import numpy as np

from hmap_core.kinematics.urdf import Urdf


class LinkPoints:
    """The hulls of a robot's links, seen from one of its links.

    Args:
        urdf: the robot description.
        link: whose frame the points are in.
    """

    def __init__(self, urdf: Urdf, link: str):
        self._urdf = urdf
        self._link = link

    def has_shape(self, link: str) -> bool:
        """Whether a link has a collision shape."""
        return bool(self._urdf.hulls[link])

    def frame(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """Pose (4, 4) of a link at joint values (rad or m)."""
        tree = self._urdf.tree
        return np.linalg.inv(tree.pose(self._link, values)) @ tree.pose(link, values)

    def of(self, link: str, values: Mapping[str, float]) -> list[tuple[np.ndarray, float]]:
        """Vertices (n, 3) and sphere radius of each hull of a link at joint values (rad or m), m."""
        T = self.frame(link, values)
        return [(points @ T[:3, :3].T + T[:3, 3], radius) for points, radius in self._urdf.hulls[link]]

    def center(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """Middle (3,) of the box around a link's shapes at joint values (rad or m), m."""
        points = np.concatenate([points for points, _ in self.of(link, values)])
        return 0.5 * (points.min(axis=0) + points.max(axis=0))

    def lowest(self, link: str, values: Mapping[str, float], direction: np.ndarray) -> float:
        """Smallest coordinate (m) of a link's shapes along a direction (3,) at joint values (rad or m)."""
        return min(float((points @ direction).min()) - radius for points, radius in self.of(link, values))
