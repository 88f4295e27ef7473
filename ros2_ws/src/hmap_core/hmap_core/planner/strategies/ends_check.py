"""Whether a hand fits on the object where it starts, and at its goal: asked once the cheap strategies have failed."""

from typing import TYPE_CHECKING

from hmap_core.planner import reachability
from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import PathTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class EndsCheck:
    """Ends the job if no hand fits on the object at one end, since each further strategy has a contact at both."""

    name = "whether a hand fits at the start and at the goal"

    def applies(self, task: PathTask) -> bool:
        """Whether it is the first round of the task's own object, in a physical task."""
        return task.number == 0 and task.subgoal.depth == 0 and not task.kinematic

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Check; nothing is solved by that.

        Raises:
            ContactError: NO_CONTACT; no hand fits at the start. OUT_OF_REACH; none fits at the goal.
        """
        failure = search.context.record.last_failure()
        reachability.check_start(search.context, task)
        reachability.check_hand_at_goal(search.context, task)
        return failure
