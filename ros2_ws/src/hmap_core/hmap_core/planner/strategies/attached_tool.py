"""Contacts with the tool that a robot holds already."""

from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import WaypointTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class AttachedToolStrategy:
    """Contacts of the attached tool on the object."""

    name = "with the attached tool"

    def applies(self, task: WaypointTask) -> bool:
        """Whether a tool is attached."""
        return task.sequence.tool_grasp is not None

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try contacts of that tool."""
        return search.try_contacts(task, task.sequence.tool_grasp)
