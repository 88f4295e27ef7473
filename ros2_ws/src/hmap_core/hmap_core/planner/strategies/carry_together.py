"""Two robots carry the object together, by a grasp each, where one arm does not serve."""

from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Failure, Outcome
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.two_arms import TwoArms, possible

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

ROUNDS = 2  # of the outer loop in which two arms are tried


class CarryTogether:
    """Two arms, if no robot has a grasp that serves at start and goal alone, by its reach or by the weight."""

    name = "two arms"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical, about the task's own object, and several contacts may be used."""
        return task.subgoal.depth == 0 and task.number < ROUNDS and task.may_change_contacts

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try pairs of grasps."""
        record = search.context.record
        arms = TwoArms.of(search, task) if possible(search.context.scene) else None
        if arms is None or arms.grasps.alone() or not arms.grasps.promising():
            return record.last_failure()
        outcome = arms.solve()
        if isinstance(outcome, Failure) and outcome.error is not None:
            record.failed(outcome.error)
        return outcome
