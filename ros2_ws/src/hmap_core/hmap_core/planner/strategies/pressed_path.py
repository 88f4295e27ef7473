"""Press and drag: hands press on a flat object from above and drag it over its support."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.loads import tilts
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.sampled_presses import press_of
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.types import Goal, SceneState
from hmap_core.waypoints import NoObjectPath

if TYPE_CHECKING:
    from hmap_core.planner.context import SearchContext
    from hmap_core.planner.search import Search

LEVEL = 1e-3  # m of height between start and goal of an object that is dragged
CHECKS = 100_000  # motions checked for the path of the object


class PressedPath:
    """A path on the support, along which hands press on the object."""

    name = "object path dragged from above"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical and several contacts may be used."""
        return task.may_slide and task.subgoal.attached_path is None

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Plan a path on the support and follow it with presses, if friction allows them."""
        context = search.context
        state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
        goal = goal_of_round(context, task, state)
        start, scene = state.poses[task.object], context.scene
        ends = np.array([start, goal.pose])
        level = float(np.ptp(ends[:, 2])) < LEVEL and not tilts(start, goal)
        if not level or not any(press_of(scene, state, task.object, name, ends).possible for name in scene.robots):
            return context.record.last_failure()
        pressed = replace(task.subgoal, pressed=True)
        outcome: Outcome = context.record.last_failure()
        for poses in self._paths(context, task, state, goal):
            with context.record.tree.attempt(f"{len(poses)} poses"):
                outcome = search.follow(pressed, task.sequence, poses)
            if isinstance(outcome, Solution) or outcome.ends_round:
                break
        return outcome

    def _paths(self, context: "SearchContext", task: PathTask, state: SceneState, goal: Goal) -> Iterator[np.ndarray]:
        """Different paths (M, 7) on the support: one that is short, and one made of legs straight along the sides.

        What is high and narrow is dragged along its longer side only.
        """
        fixed = replace(path_scene(context.scene, task), motion="planar", removable={})
        query = ObjectPathQuery(fixed, state, goal, context.seed(), context.time_left(), CHECKS)
        try:
            poses = context.components.object_path.plan_path(query).poses
        except NoObjectPath:
            return
        yield poses
        legs = push_planner(context.scene, state, task.object, poses).path(poses, None)
        if legs is not None and not np.array_equal(legs, poses):
            yield legs
