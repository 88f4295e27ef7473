"""Keep a subgoal as it was planned."""

from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.strategies.repair.base import RepairTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class AsPlanned:
    """The old motion, if it begins in the present state and is free."""

    name = "as planned"
    kept = "motions"

    def applies(self, task: RepairTask) -> bool:
        """Whether robots and objects are as planned, and all of it is free."""
        repair, subgoal, state = task.repair, task.subgoal, task.state
        if subgoal.first < repair.at or not repair.robots_as_planned(state, subgoal.first):
            return False
        return repair.objects_as_planned(subgoal, state) and repair.is_free(subgoal, state, subgoal.first, subgoal.last)

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Copy the motion."""
        return Solution(task.sequence.after(task.repair.copied(task.subgoal, task.subgoal.first)))
