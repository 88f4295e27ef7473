"""How a command to a controller ends."""

from enum import StrEnum


class Outcome(StrEnum):
    """How a command ended; ACTIVE: it has not yet."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    PREEMPTED = "preempted"  # another command took its place
    PATH_TOLERANCE_VIOLATED = "path_tolerance_violated"
    GOAL_TOLERANCE_VIOLATED = "goal_tolerance_violated"
    STALLED = "stalled"  # gripper: stopped by something between the fingers
