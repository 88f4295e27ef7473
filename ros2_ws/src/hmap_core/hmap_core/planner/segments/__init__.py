"""The motions of one robot: to a contact, with an object, away from it, and transit alone. Solved by KOMO and verified.

The skeleton of a segment is eq. (2) of the paper: ``pose_eq`` with the pre-contact pose at the end of the transit, a
straight approach, ``touch`` at the mode switch, ``stable`` while the object moves, with its waypoints as ``pose_eq``,
and a straight retreat.
"""

from hmap_core.planner.segments.attached import attach_body
from hmap_core.planner.segments.hand_over import pass_on
from hmap_core.planner.segments.motions import come, go, leave, pick, place, solve_segment
from hmap_core.planner.segments.shared_carry import carry_together
from hmap_core.planner.segments.timing import (
    FREE_ACCELERATION,
    FREE_SPEED,
    HOLD_ACCELERATION,
    HOLD_SPEED,
    timed_together,
)
from hmap_core.planner.segments.transits import standing_collision

__all__ = [
    "FREE_ACCELERATION",
    "FREE_SPEED",
    "HOLD_ACCELERATION",
    "HOLD_SPEED",
    "attach_body",
    "carry_together",
    "come",
    "go",
    "leave",
    "pass_on",
    "pick",
    "place",
    "solve_segment",
    "standing_collision",
    "timed_together",
]
