"""Paths made of pushes in other directions than those in which no contact brought the object on."""

from typing import TYPE_CHECKING

from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.hand import hand_of
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 4  # paths; each adds a direction that is avoided


class PushedAround:
    """Turns the object on its way, so that hands push it where they reach its sides."""

    name = "object path made of pushes in other directions"

    def applies(self, task: PathTask) -> bool:
        """Whether no contact served in some direction, and several contacts may be used."""
        return task.ready is not None and task.may_slide and bool(task.unserved)

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Follow paths without the directions that failed; only what no hand grips."""
        context = search.context
        ready = task.require_ready()
        state = with_tool_placed(ready.state, ready.tool_grasp)
        hands = [hand_of(robot) for robot in context.scene.robots.values()]
        if grippable(context.scene.bodies[task.object], state.poses[task.object], hands):
            return context.record.last_failure()
        pushes = push_planner(context.scene, state, task.object, task.poses)
        for _ in range(TRIED):
            pushed = pushes.path(task.poses, None, task.unserved)
            if pushed is None:
                break
            with context.record.tree.attempt(f"{len(pushed)} poses"):
                outcome = search.follow(task.subgoal, ready, pushed)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
            task.stopped(outcome, pushed)
        return context.record.last_failure()
