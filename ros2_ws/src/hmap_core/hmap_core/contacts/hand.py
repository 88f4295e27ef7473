"""The hand of a robot as the contact sampler sees it."""

from hmap_core.contacts.candidates import Hand
from hmap_core.kinematics.arm import load_arm
from hmap_core.types import Robot


def hand_of(robot: Robot) -> Hand:
    """A robot's hand, or what it holds; an arm without fingers touches with its last link."""
    model = robot.model
    arm = load_arm(model)
    tip = arm.finger_vertices(0.0)
    return Hand(tip if len(tip) else arm.tip_vertices(), None if model.held else model.gripper, model.held)
