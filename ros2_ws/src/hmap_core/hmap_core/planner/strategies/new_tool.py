"""A robot picks a tool, and moves the object with it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.exceptions import Code, ContactError, MotionError
from hmap_core.planner import steps
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.obstacle_removal import RemovalError
from hmap_core.planner.obstruction import stacked_on, without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.solution_sequence import SolutionSequence, removable_for
from hmap_core.planner.steps import TRIES_WITH_TOOL
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import tools_of
from hmap_core.types import BodyKind, Scene

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

GRASPS_TRIED = 6  # on tools, at one waypoint


class NewTool:
    """Grasps on tools, the best first: contacts of the tool, then pick it, then the motion.

    Args:
        likely: probability with which the ranker has to expect that a grasp serves; else none is tried.
    """

    name = "with a tool"

    def __init__(self, likely: float = 0.0):
        self._likely = likely

    def applies(self, task: WaypointTask) -> bool:
        """Whether there are tools."""
        return bool(tools_of(task.context.scene, task.object))

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Try up to GRASPS_TRIED grasps. Contacts are found before the tool is picked.

        What stands on a tool is removed first. Tools that carry what may not be moved are left out.
        """
        context, record = task.context, task.context.record
        sequence = steps.place_tool(context, task.sequence)
        if sequence is None:
            return record.last_failure()
        context.report("contacts", task.at, task.total, text=f"tools for '{task.object}'")
        loads = {tool: stacked_on(context.scene, sequence.state, tool) for tool in tools_of(context.scene, task.object)}
        may_go = removable_for(context.scene, task.subgoal, sequence)
        bare = _without_loads(context, loads, may_go)
        grasps = context.components.tools.tool_grasps(
            bare, sequence.state, task.object, task.ahead, context.seed(), context.time_left(), self._likely
        )
        cleared: dict[str, SolutionSequence | None] = {}
        for grasp, _ in grasps[:GRASPS_TRIED]:
            if grasp.tool not in cleared:
                cleared[grasp.tool] = _unloaded(search, task, sequence, grasp.tool, loads[grasp.tool])
            ready = cleared[grasp.tool]
            if ready is None:
                continue
            with record.tree.attempt(f"{grasp.robot} picks '{grasp.tool}'") as node:
                outcome = self._with(search, replace(task, sequence=ready), grasp)
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


def _without_loads(context: SearchContext, loads: Mapping[str, Sequence[str]], may_go: Collection[str]) -> Scene:
    """The scene without what may be removed from tools; tools that carry anything else are no tools in it."""
    scene = context.scene
    gone = {load for on_tool in loads.values() for load in on_tool if load in may_go}
    for tool, on_tool in loads.items():
        stays = [load for load in on_tool if load not in may_go]
        if stays:
            reason = f"the tool '{tool}' carries '{stays[0]}', which may not be moved"
            context.record.failed(ContactError(reason, Code.NO_CONTACT))
            kept = replace(scene.bodies[tool], kind=BodyKind.MOVABLE)
            scene = replace(scene, bodies=scene.bodies | {tool: kept})
    return without(scene, gone) if gone else scene


def _unloaded(
    search: "Search", task: WaypointTask, sequence: SolutionSequence, tool: str, load: Sequence[str]
) -> SolutionSequence | None:
    """The sequence once nothing stands on a tool; None if something cannot be removed from it."""
    if not load:
        return sequence
    subgoal = replace(task.subgoal, busy=task.subgoal.busy | {tool})
    try:
        return search.removal.clear(subgoal, sequence, load, ())
    except RemovalError as error:
        task.context.record.failed(error)
        return None
