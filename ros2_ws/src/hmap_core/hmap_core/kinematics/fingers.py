"""How parts of a hand move with the opening of its gripper: fingers that slide, and linkages that turn."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.scenes.urdf import UrdfJoint
from hmap_core.types import Gripper

OPENINGS = 33  # of a linkage's range, at which the farthest that it sticks out is looked for
KNOWN = 1024  # openings of which a linkage remembers where it was


@dataclass(frozen=True)
class Slide:
    """Moves straight: ``way`` (3,) is how far, in the frame that carries it, per metre of opening."""

    way: np.ndarray

    def moved(self, points: np.ndarray, opening: float) -> np.ndarray:
        """Where points (..., 3) of the gripper at opening 0 are at an opening (m)."""
        return points + self.way * opening

    def extent(self, points: np.ndarray, radius: float, gripper: Gripper) -> float:
        """Farthest that balls about points (m, 3) come from the frame's origin, m."""
        return float(np.linalg.norm(points, axis=1).max() + radius + np.linalg.norm(self.way) * gripper.open_opening)


@dataclass(frozen=True)
class LinkageStep:
    """A joint on the way to a link, with the fixed transform (4, 4) to it.

    Attributes:
        driver: number of the gripper's joint that it is, or follows.
        factor, offset: its value for each of that one's, and at that one's zero.
    """

    T: np.ndarray
    joint: UrdfJoint
    driver: int
    factor: float
    offset: float


@dataclass(frozen=True)
class Linkage:
    """Moves as joints have it that turn with the gripper.

    Args:
        steps: the joints from the frame that carries the linkage to the link.
    """

    gripper: Gripper
    steps: Sequence[LinkageStep]
    _opened: np.ndarray = field(init=False)  # (4, 4), the closed link's frame, inverted
    _known: dict[float, np.ndarray] = field(init=False, default_factory=dict)

    def __post_init__(self):
        object.__setattr__(self, "_opened", np.linalg.inv(steps_frame(self.gripper, self.steps, closed(self.gripper))))

    def moved(self, points: np.ndarray, opening: float) -> np.ndarray:
        """Where points (..., 3) of the closed gripper are at an opening (m)."""
        if opening not in self._known:
            if len(self._known) == KNOWN:
                self._known.clear()
            self._known[opening] = steps_frame(self.gripper, self.steps, opening) @ self._opened
        T = self._known[opening]
        return points @ T[:3, :3].T + T[:3, 3]

    def extent(self, points: np.ndarray, radius: float, gripper: Gripper) -> float:
        """Farthest that balls about points (m, 3) come from the frame's origin, m."""
        openings = np.linspace(gripper.min_opening, gripper.open_opening, OPENINGS)
        return max(float(np.linalg.norm(self.moved(points, opening), axis=1).max()) for opening in openings) + radius


def closed(gripper: Gripper) -> float:
    """The opening (m) at which a hull's own vertices are: of a linkage closed, else 0."""
    return gripper.min_opening if gripper.openings else 0.0


def steps_frame(gripper: Gripper, steps: Sequence[LinkageStep], opening: float) -> np.ndarray:
    """The frame (4, 4) behind some joints, in the one before them, at an opening (m)."""
    joints, T = gripper.joints(opening), np.eye(4)
    for step in steps:
        T = T @ step.T @ step.joint.motion(step.factor * joints[step.driver] + step.offset)
    return T


def finger_motion(gripper: Gripper, steps: Sequence[LinkageStep]) -> Slide | Linkage:
    """How what hangs behind some joints of a gripper moves with it."""
    if gripper.openings or any(step.joint.kind != "prismatic" for step in steps):
        return Linkage(gripper, tuple(steps))
    way, T = np.zeros(3), np.eye(4)
    per_joint = np.broadcast_to(gripper.per_joint, len(gripper.joint_names))
    for step in steps:
        T = T @ step.T
        way = way + T[:3, :3] @ step.joint.axis * (step.factor * per_joint[step.driver])
    return Slide(way)
