"""A path that lifts, with its head on the support: pushes may bring the object to where a hand can grip it."""

from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Outcome
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.waypoints import ObjectPathProblem, slide_then_lift

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class SlideFirst:
    """Slide first, lift later."""

    name = "object path that slides first"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical, there is a free path, and several contacts may be used along it."""
        return task.ready is not None and task.may_slide

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Follow the last object path with its head on the support."""
        context = search.context
        ready = task.require_ready()
        state = with_tool_placed(ready.state, ready.tool_grasp)
        around = placed_bodies(context.scene, state, task.object)
        body, poses = context.scene.bodies[task.object], task.poses
        slid = slide_then_lift(ObjectPathProblem(body, poses[0], poses[-1], around), poses)
        if slid is None:
            return context.record.last_failure()
        return search.follow(task.subgoal, ready, slid)
