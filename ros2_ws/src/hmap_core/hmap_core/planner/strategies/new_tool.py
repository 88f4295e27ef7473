"""A robot picks a tool, and moves the object with it."""

from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.exceptions import MotionError
from hmap_core.planner import steps
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.steps import TRIES_WITH_TOOL
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import tools_of

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

GRASPS_TRIED = 6  # on tools, at one waypoint


class NewTool:
    """Grasps on tools, the best first: contacts of the tool, then pick it, then the motion."""

    name = "with a tool"

    def applies(self, task: WaypointTask) -> bool:
        """Whether there are tools."""
        return bool(tools_of(task.context.scene, task.object))

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try up to GRASPS_TRIED grasps. Contacts are found before the tool is picked."""
        context, record = task.context, task.context.record
        sequence = steps.place_tool(context, task.sequence)
        if sequence is None:
            return record.last_failure()
        context.report("contacts", task.at, task.total, text=f"tools for '{task.object}'")
        grasps = context.components.tools.tool_grasps(
            context.scene, sequence.state, task.object, task.ahead, context.seed(), context.time_left()
        )
        for grasp, _ in grasps[:GRASPS_TRIED]:
            with record.tree.attempt(f"{grasp.robot} picks '{grasp.tool}'") as node:
                outcome = self._with(search, replace(task, sequence=sequence), grasp)
                node.close(outcome)
            if isinstance(outcome, Solution):
                return replace(outcome, tool_grasp=grasp)
        return record.last_failure()

    def _with(self, search: "Search", task: WaypointTask, grasp: ToolGrasp) -> Outcome:
        """Find contacts of a tool, pick it, and move the object with it."""
        context = task.context
        contacts = steps.find_contacts(task, steps.Manipulator.of(task, grasp), TRIES_WITH_TOOL)
        if not contacts:
            return context.record.last_failure()
        context.report("motion", task.at, task.total, text=f"{grasp.robot} takes '{grasp.tool}'")
        try:
            picked = steps.pick_tool(context, task.sequence, grasp)
        except MotionError as error:
            context.record.failed(error)
            return Failure.of(error)
        contacts = [replace(contact, clear=()) for contact in contacts]  # who was away has gone home before
        return search.try_contacts(replace(task, sequence=picked), grasp, contacts)
