"""Contacts by the bare hand at one waypoint."""

from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import tools_of

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

LITTLE = 8  # poses of the path; where there are tools, contacts by hand that serve for fewer come last
SAMPLINGS = 3  # of contacts by hand before tools are considered, which takes ten times as long
RANKED_SAMPLINGS = 1  # where a ranker says which tool to look at, it takes about as long


class ByHandToTheEnd:
    """With a tool attached: only a contact by hand that covers the whole path justifies placing the tool."""

    name = "by hand to the end of the path"

    def applies(self, task: WaypointTask) -> bool:
        """Whether a tool is attached."""
        return task.sequence.tool_grasp is not None

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try contacts that cover the rest of the path."""
        return search.try_contacts(task, min_reach=len(task.ahead) - 1)


class ByHand:
    """Contacts by hand; where there are tools, only those that serve for at least LITTLE poses."""

    name = "by hand"

    def applies(self, task: WaypointTask) -> bool:
        """Always."""
        return True

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try contacts; where there are tools, sample them SAMPLINGS times first, or once if a ranker orders tools."""
        if not tools_of(task.context.scene, task.object):
            return search.try_contacts(task)
        samplings = SAMPLINGS if task.context.components.ranker is None else RANKED_SAMPLINGS
        return search.try_contacts(task, min_reach=min(LITTLE, len(task.ahead) - 1), samplings=samplings)


class ByHandWhereverItReaches:
    """Where there are tools and none serves: contacts by hand that serve for few poses."""

    name = "by hand, however far it reaches"

    def applies(self, task: WaypointTask) -> bool:
        """Whether there are tools."""
        return bool(tools_of(task.context.scene, task.object))

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try all contacts."""
        return search.try_contacts(task)
