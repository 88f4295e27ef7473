"""Motion of the links of a gripper with its opening: sliding fingers and linkages with revolute joints."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.robot_description import Joint
from hmap_core.types import Gripper

OPENINGS = 33  # number of openings of a linkage's range at which its extent is evaluated
MAX_CACHED = 1024  # number of openings whose transforms a linkage caches


@dataclass(frozen=True)
class SlidingFinger:
    """A finger that translates in proportion to the opening.

    Attributes:
        per_opening: (3,) translation per metre of opening, in the frame that carries the gripper.
    """

    per_opening: np.ndarray

    def moved(self, points: np.ndarray, opening: float) -> np.ndarray:
        """Moves points (..., 3) of the gripper at opening 0 to an opening (m)."""
        return points + self.per_opening * opening

    def extent(self, points: np.ndarray, radius: float, gripper: Gripper) -> float:
        """Bound on the distance of balls from the origin of the frame, over all openings.

        Args:
            points: (m, 3) centres of the balls at opening 0, m.
            radius: of the balls, m.
            gripper: gives the range of openings.

        Returns:
            The bound, m.
        """
        stroke = np.linalg.norm(self.per_opening) * gripper.open_opening
        return float(np.linalg.norm(points, axis=1).max() + radius + stroke)


@dataclass(frozen=True)
class LinkageStep:
    """A joint of the gripper between the frame that carries it and a link.

    Attributes:
        T: (4, 4) fixed transform from the previous joint to this one.
        joint: the joint.
        driver: index of the driven joint of the gripper that it is, or mimics.
        factor, offset: multiplier and offset of the mimic relation.
    """

    T: np.ndarray
    joint: Joint
    driver: int
    factor: float
    offset: float


@dataclass(frozen=True)
class Linkage:
    """A link that moves with revolute or mimic joints of the gripper.

    Args:
        gripper: the gripper.
        steps: the joints from the frame that carries the linkage to the link.
    """

    gripper: Gripper
    steps: Sequence[LinkageStep]
    _opened: np.ndarray = field(init=False)  # (4, 4), inverse of the closed link's frame
    _known: dict[float, np.ndarray] = field(init=False, default_factory=dict)

    def __post_init__(self):
        closed = steps_frame(self.gripper, self.steps, closed_opening(self.gripper))
        object.__setattr__(self, "_opened", np.linalg.inv(closed))

    def moved(self, points: np.ndarray, opening: float) -> np.ndarray:
        """Moves points (..., 3) of the closed gripper to an opening (m)."""
        if opening not in self._known:
            if len(self._known) == MAX_CACHED:
                self._known.clear()
            self._known[opening] = steps_frame(self.gripper, self.steps, opening) @ self._opened
        T = self._known[opening]
        return points @ T[:3, :3].T + T[:3, 3]

    def extent(self, points: np.ndarray, radius: float, gripper: Gripper) -> float:
        """Largest distance of balls from the origin of the frame, over sampled openings.

        Args:
            points: (m, 3) centres of the balls with the gripper closed, m.
            radius: of the balls, m.
            gripper: gives the range of openings.

        Returns:
            The distance, m.
        """
        openings = np.linspace(gripper.min_opening, gripper.open_opening, OPENINGS)
        return max(float(np.linalg.norm(self.moved(points, opening), axis=1).max()) for opening in openings) + radius


def closed_opening(gripper: Gripper) -> float:
    """The opening (m) that a hull's vertices refer to: closed for a linkage, else 0."""
    return gripper.min_opening if gripper.openings else 0.0


def steps_frame(gripper: Gripper, steps: Sequence[LinkageStep], opening: float) -> np.ndarray:
    """Transform of a chain of gripper joints at an opening.

    Args:
        gripper: the gripper.
        steps: the joints.
        opening: m.

    Returns:
        (4, 4), the frame after the last joint in the frame before the first.
    """
    joints, T = gripper.joints(opening), np.eye(4)
    for step in steps:
        T = T @ step.T @ step.joint.motion(step.factor * joints[step.driver] + step.offset)
    return T


def finger_motion(gripper: Gripper, steps: Sequence[LinkageStep]) -> SlidingFinger | Linkage:
    """The motion of a link that is attached to the end of some gripper joints."""
    if gripper.openings or any(step.joint.kind != "prismatic" for step in steps):
        return Linkage(gripper, tuple(steps))
    per_opening, T = np.zeros(3), np.eye(4)
    per_joint = np.broadcast_to(gripper.per_joint, len(gripper.joint_names))
    for step in steps:
        T = T @ step.T
        per_opening = per_opening + T[:3, :3] @ step.joint.axis * (step.factor * per_joint[step.driver])
    return SlidingFinger(per_opening)
