"""Kinematic model of an optimisation problem: arms and free bodies as one set of joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import Arm
from hmap_core.kinematics.branch import Branch
from hmap_core.kinematics.chain import Chain
from hmap_core.kinematics.free_body import FreeBody
from hmap_core.transforms import from_matrix, to_matrix


@dataclass(frozen=True)
class PlacedArm:
    """An arm at a base pose in the world."""

    name: str
    arm: Arm
    T_world_base: np.ndarray  # (7,)

    def branch(self) -> Branch:
        """The joints of the arm as :class:`KinematicModel` expects them."""
        base = to_matrix(self.T_world_base)
        R, p = self.arm.R_joint.copy(), self.arm.p_joint.copy()
        R[0], p[0] = base[:3, :3] @ R[0], base[:3, :3] @ p[0] + base[:3, 3]
        lower, upper = self.arm.model.position_limits
        return Branch(
            R, p, self.arm.prismatic, lower, upper, self.arm.reach(), from_matrix(self.arm.T_tip_ee),
        )  # fmt: skip


class KinematicModel:
    """Joint space of several arms and free bodies.

    Frame 0 is the world. The joints are numbered consecutively in the order of the parts; frame i + 1 follows joint i.

    Args:
        parts: arms and free bodies, at least one.

    Attributes:
        arms, bodies: the arms and the free bodies by name.
        offset: name -> index of its first joint.
        n: number of joints.
        chain: the joints in the form that compiled code needs.

    Raises:
        InputError: INVALID_SCENE; no part, or two parts with the same name.
    """

    def __init__(self, parts: Sequence[PlacedArm | FreeBody]):
        names = [part.name for part in parts]
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"parts {names} of a kinematic model; allowed: one or more, each name once", Code.INVALID_SCENE
            )
        self.arms = {part.name: part for part in parts if isinstance(part, PlacedArm)}
        self.bodies = {part.name: part for part in parts if isinstance(part, FreeBody)}
        self._branches = {part.name: part.branch() for part in parts}
        self.offset, self.n = {}, 0
        parent, first = [], [0]
        for name, branch in self._branches.items():
            count = len(branch.prismatic)
            self.offset[name] = self.n
            parent += [0, *range(self.n + 1, self.n + count)]
            first += [self.n] * count
            self.n += count
        joined = lambda field: np.concatenate([getattr(b, field) for b in self._branches.values()])  # noqa: E731
        self.chain = Chain(
            np.array(parent, np.int64), joined("R_joint"), joined("p_joint"), joined("prismatic"),
            np.array(first, np.int64), joined("lower"), joined("upper"), joined("reach"),
        )  # fmt: skip

    def joints(self, name: str) -> slice:
        """The joints of an arm, or the coordinates of a free body, as a slice of a configuration (n,)."""
        begin = self.offset[name]
        return slice(begin, begin + len(self._branches[name].prismatic))

    def frame(self, name: str, local: int) -> int:
        """Index of a part's frame.

        Args:
            name: of the part.
            local: index of the frame within the part; 0 is its base, which is the world frame.
        """
        return 0 if local == 0 else self.offset[name] + local

    def tip(self, name: str) -> int:
        """Index of the frame after the last joint of a part."""
        return self.joints(name).stop

    def T_tip_ee(self, name: str) -> np.ndarray:
        """Pose (7,) of a part's end in the tip frame: of an arm's end effector, or of a free body."""
        return self._branches[name].T_tip_end
