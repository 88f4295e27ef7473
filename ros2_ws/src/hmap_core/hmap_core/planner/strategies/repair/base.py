"""What the strategies of plan repair have in common."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hmap_core import transforms
from hmap_core.planner.conflicts import first_conflict
from hmap_core.planner.outcome import Outcome
from hmap_core.planner.planned_subgoals import PlannedSubgoal
from hmap_core.planner.resampling import by_length, pose_steps
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.trajectory.measured import upright
from hmap_core.types import SceneState

if TYPE_CHECKING:
    from hmap_core.planner.repair import PlanRepair
    from hmap_core.planner.search import Search

POSITION_STEP, ROTATION_STEP = 0.01, float(np.deg2rad(3.0))  # m, rad between kept poses of an object
NEAR, NEAR_TURN = 0.01, float(np.deg2rad(5.0))  # m, rad off its path at which it is still continued


@dataclass(frozen=True)
class RepairTask:
    """A subgoal of the old plan that has to be achieved.

    Attributes:
        repair: the old plan and the world as it is now.
        subgoal: the subgoal.
        sequence: what has been done already.
    """

    repair: "PlanRepair"
    subgoal: PlannedSubgoal
    sequence: SolutionSequence

    @property
    def state(self) -> SceneState:
        """Where everything is."""
        return self.sequence.state

    def old_path(self) -> tuple[np.ndarray, np.ndarray] | None:
        """What is left of the object's path, if it is by hand, in one contact, near the object, and free.

        Returns:
            The samples (M,) of the plan, and the poses (M, 7), the first of which is the object's present one; what
            slides stays at its present height.
        """
        repair, contact = self.repair, self.subgoal.only_contact
        if contact is None or repair.by_tool(contact):
            return None
        name = contact.segment.contact_object
        rows = repair.plan.trajectory.objects[name]
        first = max(contact.begin, repair.at)
        moved, turned = pose_steps(rows[first : contact.end + 1], POSITION_STEP, ROTATION_STEP)
        ahead = first + by_length(np.concatenate([[0.0], np.maximum(moved, turned)]))
        off, tilt = transforms.distance(rows[ahead[0]], self.state.poses[name])
        if off > NEAR or tilt > NEAR_TURN or len(ahead) < 2:
            return None
        around, span = repair.around(self.subgoal, self.state), repair.span(ahead[0], ahead[-1])
        if first_conflict(repair.plan, around, *span, [name], robots=()) is not None:
            return None
        here = self.state.poses[name]
        poses = np.array([here, *(upright(T, here) for T in rows[ahead[1:-1]]), rows[ahead[-1]]])
        return ahead, transforms.consistent(poses)


class RepairStrategy(Protocol):
    """One way to achieve a subgoal of the old plan; the protocol is that of all strategies.

    Attributes:
        name: for people.
        kept: what of the old plan is kept, a key of :attr:`hmap_core.planner.repair.PlanRepair.kept`.
    """

    name: str
    kept: str

    def applies(self, task: RepairTask) -> bool:
        """Whether it makes sense to try this strategy."""
        ...

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Achieve the subgoal. Raises only errors that end the whole job."""
        ...


NOT_APPLICABLE = "the old plan does not serve"
