"""Straight moves of a hand that keeps its orientation: what a search in joint space hardly ever draws by itself."""

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import Phase
from hmap_core.transforms import multiply_all

STEP = 0.02  # m between two configurations of a move
MAX_JUMP = 0.3  # rad a joint may turn between two of them


class HandMoves:
    """The hand of a manipulation's robot, moved straight by inverse kinematics among collisions."""

    def __init__(self, manipulation: Manipulation, collisions: CollisionModel):
        self._manipulation = manipulation
        self._problem = manipulation.ik_problem(collisions, Phase.TRANSIT)
        self._base = manipulation.scene.robots[manipulation.robot].base_pose

    def poses(self, Q: np.ndarray) -> np.ndarray:
        """World poses (M, 7) of the hand at configurations (M, n)."""
        return multiply_all(self._base, self._manipulation.arm.end_effectors(Q))

    def along(self, q: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Configurations (m + 1, n) from q (n,) as far along ``way`` (3,), in m in the world, as the arm follows; q
        first."""
        steps = max(1, int(np.ceil(np.linalg.norm(way) / STEP)))
        poses = np.repeat(self.poses(q[None]), steps, axis=0)
        poses[:, :3] += np.linspace(0.0, 1.0, steps + 1)[1:, None] * way
        targets = pose_params_all(self._manipulation.T_tip_ee, poses)
        path = np.concatenate([q[None], follow_ik(self._problem, targets, q, MAX_JUMP)])
        near = np.abs(np.diff(path[:2], axis=0)) <= MAX_JUMP  # the first step, which follow_ik does not ask
        return path if near.all() else path[:1]
