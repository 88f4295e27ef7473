"""One serial chain of joints in the world: what a kinematic model is put together from."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Branch:
    """Joints in their order, from the world to the tip.

    Attributes:
        R_joint, p_joint: (n, 3, 3), (n, 3) fixed transform from the frame before to the joint at zero; the first from
            the world.
        prismatic: (n,) 1 where the joint slides along its z axis, 0 where it turns about it.
        lower, upper: (n,) limits, rad or m.
        reach: (n,) no point moved by a joint is farther than this from its axis, m; 1 for sliding joints.
        T_tip_end: (7,) what the branch ends with, in its last frame: an end-effector, or a body.
    """

    R_joint: np.ndarray
    p_joint: np.ndarray
    prismatic: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    reach: np.ndarray
    T_tip_end: np.ndarray
