"""Why a plan is not followed on, beside what controllers and grippers report."""

from hmap_core.exceptions import Code, ExecutionError
from hmap_core.planner.conflicts import Conflict


class Drifted(ExecutionError):
    """Between two contacts a body is too far off the plan; nothing has been lost."""

    default_code = Code.GOAL_MISSED


class Blocked(ExecutionError):
    """A body that the plan does not know is in its way; robots are at rest, and hands are free.

    Attributes:
        conflict: what meets what, and when.
        at: planned time (s) up to which the object followed the plan.
    """

    default_code = Code.WAY_BLOCKED

    def __init__(self, conflict: Conflict, at: float):
        super().__init__(f"{conflict.body!r} is in the way of {conflict.what!r} at {conflict.time:.2f} s of the plan")
        self.conflict, self.at = conflict, at
