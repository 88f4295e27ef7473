"""Whether a hand fits on the object where it starts: asked once the cheap strategies have found no contact."""

from typing import TYPE_CHECKING

from hmap_core.planner import reachability
from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import PathTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class StartCheck:
    """Ends the job if no hand fits on the object where it starts, since each further strategy begins with a contact."""

    name = "whether a hand fits at the start"

    def applies(self, task: PathTask) -> bool:
        """Whether it is the first round of the task's own object, in a physical task."""
        return task.number == 0 and task.subgoal.depth == 0 and not task.kinematic

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Check; nothing is solved by that.

        Raises:
            ContactError: NO_CONTACT; no hand fits.
        """
        reachability.check_start(search.context, task)
        return search.context.record.last_failure()
