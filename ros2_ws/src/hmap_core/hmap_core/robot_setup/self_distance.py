"""Distances between the links of an arm."""

import numpy as np

from hmap_core.collision.convex import ConvexSet, from_hulls, set_distance
from hmap_core.kinematics.arm import Arm
from hmap_core.transforms import from_matrix

FAR = 0.05  # m; larger distances are not told apart


class SelfDistance:
    """Distances between the links of an arm, with its gripper open.

    Args:
        arm: the arm; its ``self_pairs`` are checked.
    """

    def __init__(self, arm: Arm):
        self._arm = arm
        opening = arm.model.gripper.open_opening if arm.model.gripper else 0.0
        self._sets: list[ConvexSet] = [from_hulls([(hull.at(opening), hull.radius)]) for hull in arm.hulls]

    def nearest(self, q: np.ndarray) -> tuple[float, tuple[str, str] | None]:
        """The links that are nearest to each other.

        Args:
            q: (n,) configuration, rad or m.

        Returns:
            Their distance (m), negative in collision and at most FAR, and their names; None if all are farther.
        """
        hulls, poses = self._arm.hulls, self._poses(q)
        least: float = FAR
        pair = None
        for a, b in self._arm.self_pairs:
            T_a, T_b = poses[hulls[a].frame], poses[hulls[b].frame]
            distance = set_distance(self._sets[a], T_a, self._sets[b], T_b, least)
            if distance < least:
                least, pair = distance, (hulls[a].link, hulls[b].link)
        return least, pair

    def lowest(self, q: np.ndarray) -> float:
        """Smallest height (m) of the links beyond the first joint over the base's origin, at a configuration (n,)."""
        R, p = self._arm.frames(q)
        moving = [(s, h.frame, h.radius) for s, h in zip(self._sets, self._arm.hulls, strict=True) if h.frame > 1]
        return min((float((s.vertices @ R[f].T + p[f])[:, 2].min()) - r for s, f, r in moving), default=np.inf)

    def _poses(self, q: np.ndarray) -> list[np.ndarray]:
        poses = []
        for R, p in zip(*self._arm.frames(q), strict=True):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, p
            poses.append(from_matrix(T))
        return poses
