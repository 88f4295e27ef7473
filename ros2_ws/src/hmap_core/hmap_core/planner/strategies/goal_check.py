"""Whether arms with few joints reach the goal: asked before the long searches, in which they seldom find a way."""

from typing import TYPE_CHECKING

from hmap_core.planner import reachability
from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tilt import keeps_tilt

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class GoalCheck:
    """Ends the job if no contact brings the object to its goal, where no robot reaches every orientation.

    Arms with more joints are asked at the end of the round: they have more ways to a goal than the last path showed.
    """

    name = "whether a hand reaches the goal"

    def applies(self, task: PathTask) -> bool:
        """Whether it is the first round of the task's own object, in a physical task."""
        return task.number == 0 and task.subgoal.depth == 0 and not task.kinematic

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Check; nothing is solved by that.

        Raises:
            ContactError: OUT_OF_REACH; no contact brings the object there.
        """
        if keeps_tilt(search.context.scene):
            reachability.check_goal(search.context, task)
        return search.context.record.last_failure()
