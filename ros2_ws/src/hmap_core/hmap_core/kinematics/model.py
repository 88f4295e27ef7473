"""One or more arms in the world as one chain of joints: the variables of an optimisation problem."""

from dataclasses import dataclass

import numpy as np

from hmap_core.kinematics.arm import Arm
from hmap_core.kinematics.chain import Chain
from hmap_core.transforms import from_matrix, to_matrix

LIMIT_MARGIN = 0.02  # rad or m kept from the joint limits, for the curve between the steps of a path


@dataclass(frozen=True)
class PlacedArm:
    """An arm with its base in the world."""

    name: str
    arm: Arm
    T_world_base: np.ndarray  # (7,)


class KinematicModel:
    """Arms side by side: frame 0 is the world, joints of all arms are numbered through, frame i + 1 follows joint i."""

    def __init__(self, arms: list[PlacedArm]):
        self.arms = {placed.name: placed for placed in arms}
        self.offset = {}
        parent, first, R, p = [], [0], [], []
        n = 0
        for placed in arms:
            self.offset[placed.name] = n
            base = to_matrix(placed.T_world_base)
            for k in range(placed.arm.n):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = placed.arm.R_joint[k], placed.arm.p_joint[k]
                if k == 0:
                    T = base @ T
                R.append(T[:3, :3])
                p.append(T[:3, 3])
                parent.append(0 if k == 0 else n + k)
                first.append(n)
            n += placed.arm.n
        self.n = n
        limits = [placed.arm.model.position_limits for placed in arms]
        self.chain = Chain(
            np.array(parent, np.int64),
            np.ascontiguousarray(R),
            np.ascontiguousarray(p),
            np.concatenate([placed.arm.prismatic for placed in arms]),
            np.array(first, np.int64),
            np.concatenate([limit[0] + LIMIT_MARGIN for limit in limits]),
            np.concatenate([limit[1] - LIMIT_MARGIN for limit in limits]),
            np.concatenate([placed.arm.reach() for placed in arms]),
        )

    def frame(self, name: str, local: int) -> int:
        """Number of an arm's own frame (0 = its base, which is fixed in the world)."""
        return 0 if local == 0 else self.offset[name] + local

    def tip(self, name: str) -> int:
        """Frame after the last joint of an arm."""
        return self.offset[name] + self.arms[name].arm.n

    def T_tip_ee(self, name: str) -> np.ndarray:
        """End-effector frame (7,) in the tip frame."""
        return from_matrix(self.arms[name].arm.T_tip_ee)
