"""Achieve a subgoal by Algorithm 1."""

from typing import TYPE_CHECKING

from hmap_core.exceptions import Code, PlannerError
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.repair.base import RepairTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class ReplanSubgoal:
    """Bring the object to where the old plan brings it; the last subgoal is the task itself and left to the caller."""

    name = "by Algorithm 1"
    kept = "planned"

    def applies(self, task: RepairTask) -> bool:
        """Always."""
        return True

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Run the search for this subgoal alone."""
        if task.subgoal is task.repair.ahead[-1]:
            return Failure.of(PlannerError("nothing of the old plan serves any more", Code.NO_MOTION))
        outcome = search.bring(Subgoal(task.repair.goal_of(task.subgoal)), SolutionSequence(task.state))
        if isinstance(outcome, Failure):
            return outcome
        sequence, unjudged = task.sequence, []
        for motion in outcome.sequence.motions:
            unjudged.append((sequence.state, (motion,)))
            sequence = sequence.after(motion)
        return Solution(sequence, unjudged=tuple(unjudged))
