"""What a strategy returns: a solution, or a failure that says what was tried."""

from dataclasses import dataclass, field

import numpy as np

from hmap_core.exceptions import Code, HmapError
from hmap_core.planner.interfaces import RobotContact, SubTrajectory, ToolGrasp
from hmap_core.planner.relaxed import RelaxedSolution
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.types import SceneState


@dataclass(frozen=True)
class Solution:
    """A strategy has succeeded.

    Attributes:
        sequence: the motions so far, with the state after them.
        reach: number of poses of the object's path by which the object advanced.
        waypoints: (I, 7) poses of the object at which contacts ended.
        contact: the contact by hand that solved a waypoint; None where a tool did, or nothing was moved.
        tool_grasp: the grasp on the tool that was picked for it, if one was.
        known: a contact or tool grasp that is known to work at the present waypoint.
        unjudged: motions that the judge has to see one by one, each with the state before it (plan repair).
    """

    sequence: SolutionSequence
    reach: int = 0
    waypoints: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    contact: RobotContact | None = None
    tool_grasp: ToolGrasp | None = None
    known: RelaxedSolution | None = None
    unjudged: tuple[tuple[SceneState, tuple[SubTrajectory, ...]], ...] = ()


@dataclass(frozen=True)
class Failure:
    """A strategy has failed; what it tried is in the search tree.

    Attributes:
        stage, code, reason: as in :class:`hmap_core.exceptions.HmapError`.
        error: the error that says so, where there is one.
        ends_round: no other strategy can help as long as the object's path is the same.
        reached: what was done until then, if it has brought the object on.
        at: index of the pose of the object's path from which no contact brought it on; None if no path was followed.
    """

    stage: str
    code: Code
    reason: str
    error: HmapError | None = None
    ends_round: bool = False
    reached: SolutionSequence | None = None
    at: int | None = None

    @staticmethod
    def of(error: HmapError, ends_round: bool = False) -> "Failure":
        """The failure that an error describes."""
        return Failure(error.stage, error.code, error.reason, error, ends_round)


Outcome = Solution | Failure
