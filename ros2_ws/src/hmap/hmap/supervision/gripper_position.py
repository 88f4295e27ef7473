"""What the number ``position`` of a GripperCommand means: drivers differ."""

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.types import Gripper

GAP, FINGER, JOINT = "gap", "finger", "joint"
MEANINGS = {
    GAP: "the gap between the fingers, m",
    FINGER: "the way of one finger from the middle, half the gap, m; as franka_gripper",
    JOINT: "the value of the first driven joint, m or rad; as ros2_control's gripper controllers",
}
PARAMETER = "gripper_position"
DESCRIPTION = "what a GripperCommand's position is: " + "; ".join(f"{key}: {text}" for key, text in MEANINGS.items())


class GripperPosition:
    """Converts between openings and positions of commands.

    Args:
        meaning: a key of MEANINGS.

    Raises:
        InputError: it is another one.
    """

    def __init__(self, meaning: str = GAP):
        if meaning not in MEANINGS:
            raise InputError(f"parameter {PARAMETER} = {meaning!r}: unknown; allowed: {', '.join(MEANINGS)}")
        self._meaning = meaning

    def position(self, gripper: Gripper, opening: float) -> float:
        """The position for an opening (m)."""
        if self._meaning == JOINT:
            return float(gripper.joints(opening)[0])
        return opening / 2.0 if self._meaning == FINGER else opening

    def opening(self, gripper: Gripper, position: float) -> float:
        """The opening (m) at a position."""
        if self._meaning == JOINT:
            closed, opened = np.array(gripper.joints(0.0)), np.array(gripper.joints(gripper.open_opening))
            share = (position - closed[0]) / (opened[0] - closed[0])  # of the travel, the same for all joints
            return gripper.opening_at((closed + share * (opened - closed)).tolist())
        return 2.0 * position if self._meaning == FINGER else position
