"""One base for every error; each carries the stage it came from, a numbered code and a reason.

The numbers are those of ``hmap_msgs/msg/ErrorCode``: an exception of the core becomes that number at the interface.
"""

from enum import IntEnum


class Code(IntEnum):
    """Numbered reasons. 0 is success; hundreds are the stage."""

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
    # anything else
    INTERNAL = 900


class HmapError(Exception):
    """Base of every error of hmap.

    Attributes:
        stage: where it arose: ``input``, ``waypoints``, ``contacts``, ``motion``, ``planner``, ``execution``.
        code: a :class:`Code`.
        reason: one sentence that names the thing, its value and what is allowed.
    """

    stage = "internal"
    default_code = Code.INTERNAL

    def __init__(self, reason: str, code: Code | None = None):
        self.code = self.default_code if code is None else code
        self.reason = reason
        super().__init__(f"[{self.stage}/{self.code.name}] {reason}")


class InputError(HmapError):
    """Something given by the user is wrong: scene file, task name, pose, parameter, plan file."""

    stage = "input"
    default_code = Code.INVALID_INPUT


class WaypointError(HmapError):
    """The object has no path of its own (Algorithm 2)."""

    stage = "waypoints"
    default_code = Code.NO_OBJECT_PATH


class ContactError(HmapError):
    """No robot finds a feasible contact (Algorithm 3)."""

    stage = "contacts"
    default_code = Code.NO_CONTACT


class MotionError(HmapError):
    """No collision-free motion was found for a contact (KOMO)."""

    stage = "motion"
    default_code = Code.NO_MOTION


class PlannerError(HmapError):
    """Algorithm 1 gave up: time limit, cancel, or a plan that the judge rejects."""

    stage = "planner"
    default_code = Code.TIME_LIMIT


class ExecutionError(HmapError):
    """The simulated or real robot did not do what the plan says."""

    stage = "execution"
    default_code = Code.TRACKING_LOST
