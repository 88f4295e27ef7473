"""Straight moves of a hand that keeps its orientation: what a search in joint space hardly ever draws by itself."""

import math
from functools import lru_cache

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import Phase
from hmap_core.transforms import multiply, multiply_all

STEP = 0.02  # m between two configurations of a move
MAX_JUMP = 0.3  # rad a joint may turn between two of them


@lru_cache(maxsize=256)
def fractions(steps: int) -> np.ndarray:
    """Evenly spaced numbers (steps + 1, 1) from 0 to 1, read-only."""
    found = np.linspace(0.0, 1.0, steps + 1)[:, None]
    found.flags.writeable = False
    return found


class HandMoves:
    """The hand of a manipulation's robot, moved straight by inverse kinematics among collisions."""

    def __init__(self, manipulation: Manipulation, collisions: CollisionModel):
        self._manipulation = manipulation
        self._problem = manipulation.ik_problem(collisions, Phase.TRANSIT)
        self._base = manipulation.scene.robots[manipulation.robot].base_pose

    def poses(self, Q: np.ndarray) -> np.ndarray:
        """World poses (M, 7) of the hand at configurations (M, n)."""
        if len(Q) == 1:
            return multiply(self._base, self._manipulation.arm.end_effector(Q[0]))[None]
        return multiply_all(self._base, self._manipulation.arm.end_effectors(Q))

    def along(self, q: np.ndarray, way: np.ndarray, hand: np.ndarray | None = None) -> np.ndarray:
        """Configurations (m + 1, n) from q (n,) as far along a way as the arm follows; q first.

        Args:
            q: (n,).
            way: (3,) in the world, m.
            hand: (7,) world pose of the hand at q, if it is known.
        """
        steps = max(1, math.ceil(math.dist(way, (0.0, 0.0, 0.0)) / STEP))
        poses = np.repeat(self.poses(q[None]) if hand is None else hand[None], steps, axis=0)
        poses[:, :3] += fractions(steps)[1:] * way
        targets = pose_params_all(self._manipulation.T_tip_ee, poses)
        path = np.concatenate([q[None], follow_ik(self._problem, targets, q, MAX_JUMP)])
        near = np.abs(np.diff(path[:2], axis=0)) <= MAX_JUMP  # the first step, which follow_ik does not ask
        return path if near.all() else path[:1]
