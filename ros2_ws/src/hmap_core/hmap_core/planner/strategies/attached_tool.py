"""Contacts with the tool that a robot holds already."""

from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import WaypointTask


class AttachedToolStrategy:
    """Contacts of the attached tool on the object."""

    name = "with the attached tool"

    def applies(self, task: WaypointTask) -> bool:
        """Whether a tool is attached."""
        return task.sequence.tool_grasp is not None

    def solve(self, search, task: WaypointTask) -> Outcome:
        """Try contacts of that tool."""
        return search.try_contacts(task, task.sequence.tool_grasp)
