"""A serial chain of joints with its base in the world; kinematic models consist of such branches."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Branch:
    """A serial chain of n joints, ordered from the world to the tip.

    Attributes:
        R_joint, p_joint: (n, 3, 3) and (n, 3) fixed transform from the previous frame to the joint frame at value zero;
            for the first joint from the world.
        prismatic: (n,) 1 for a joint that slides along its z axis, 0 for one that rotates about it.
        lower, upper: (n,) limits, rad or m.
        reach: (n,) bound on the distance of the points that a joint moves from its axis, m; 1 for prismatic joints.
        T_tip_end: (7,) pose of the end (an end effector or a body) in the last frame.
    """

    R_joint: np.ndarray
    p_joint: np.ndarray
    prismatic: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    reach: np.ndarray
    T_tip_end: np.ndarray
