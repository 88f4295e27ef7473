"""The exceptions of hmap: one base class, and one subclass for each stage of planning and execution.

Each exception carries the stage, a numbered code and a reason. The numbers are those of ``hmap_msgs/msg/ErrorCode``, so
an exception of the core becomes an error code at the ROS interface.
"""

from enum import IntEnum
from typing import Any


class Code(IntEnum):
    """Numbered reasons of failure. 0 is success; the hundreds digit is the stage."""

    SUCCESS = 0
    # input
    INVALID_INPUT = 100
    UNKNOWN_TASK = 101
    UNKNOWN_OBJECT = 102
    UNKNOWN_ROBOT = 103
    INVALID_SCENE = 104
    INVALID_POSE = 105
    INVALID_PLAN_FILE = 106
    START_IN_COLLISION = 107
    GOAL_IN_COLLISION = 108
    STALE_STATE = 109
    # waypoints (Algorithm 2)
    NO_OBJECT_PATH = 200
    # contacts (Algorithm 3)
    NO_CONTACT = 300
    OUT_OF_REACH = 301
    # motion (KOMO)
    NO_MOTION = 400
    SOLVER_DIVERGED = 401
    # planner (Algorithm 1)
    TIME_LIMIT = 500
    PLAN_REJECTED = 501
    CANCELED = 502
    SERVICE_UNAVAILABLE = 503
    # execution
    TRACKING_LOST = 600
    GOAL_MISSED = 601
    OBJECT_DROPPED = 602
    WAY_BLOCKED = 603
    NODE_LOST = 604
    CONTROLLER_LOST = 605
    # anything else
    INTERNAL = 900


class HmapError(Exception):
    """Base class of all exceptions of hmap.

    Args:
        reason: one sentence that names the object, its value and what is allowed.
        code: number of the reason; the class's ``default_code`` if None.

    Attributes:
        stage: the stage that failed: ``input``, ``waypoints``, ``contacts``, ``motion``, ``planner`` or ``execution``.
        code: a :class:`Code`.
        reason: as given.
        search: the search tree of the planning job that failed, as plain data, if there is one.
    """

    stage = "internal"
    default_code = Code.INTERNAL
    search: dict[str, Any] | None = None

    def __init__(self, reason: str, code: Code | None = None):
        self.code = self.default_code if code is None else code
        self.reason = reason
        super().__init__(f"[{self.stage}/{self.code.name}] {reason}")


class InputError(HmapError):
    """Invalid input: a scene file, task name, pose, parameter or plan file."""

    stage = "input"
    default_code = Code.INVALID_INPUT


class WaypointError(HmapError):
    """No collision-free object path was found (Algorithm 2)."""

    stage = "waypoints"
    default_code = Code.NO_OBJECT_PATH


class ContactError(HmapError):
    """No robot has a feasible contact (Algorithm 3).

    Attributes:
        nothing_fits: some thousand contacts were looked at by the hand alone, and it can make none of them.
    """

    nothing_fits = False
    stage = "contacts"
    default_code = Code.NO_CONTACT


class MotionError(HmapError):
    """No collision-free robot motion was found for a contact (KOMO)."""

    stage = "motion"
    default_code = Code.NO_MOTION


class PlannerError(HmapError):
    """Algorithm 1 stopped without a plan: time limit, cancellation, or a plan that the judge rejects."""

    stage = "planner"
    default_code = Code.TIME_LIMIT


class ExecutionError(HmapError):
    """The simulated or real robot deviated from the plan."""

    stage = "execution"
    default_code = Code.TRACKING_LOST
