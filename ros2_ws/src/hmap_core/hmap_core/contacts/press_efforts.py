"""Joint efforts with which a hand presses downwards while it moves."""

import numpy as np

from hmap_core.kinematics.arm import load_arm
from hmap_core.transforms import rotation_matrix
from hmap_core.types import Robot

PRESS_TIME = 0.3  # s in which the force of a press builds up, and decays again, with the hand at rest


def press_efforts(robot: Robot, q: np.ndarray, force: float, since: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Efforts (N, n) in N m or N that press with a force on what is below the end-effector: J^T f.

    Args:
        robot: placed in the world.
        q: (N, n) its configurations.
        force: N, downwards.
        since, left: (N,) s since the beginning of the press and until its end.
    """
    arm = load_arm(robot.model)
    down = -rotation_matrix(robot.base_pose)[2]  # base frame
    share = np.clip(np.minimum(since, left) / PRESS_TIME, 0.0, 1.0)
    return np.array([s * force * (arm.tip_jacobian(row).T @ down) for s, row in zip(share, q, strict=True)])
