"""Press and drag: hands press on a flat object from above and drag it over its support."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.outcome import Failure, Outcome
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.sampled_presses import press_of
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.waypoints import NoObjectPath

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

LEVEL = 1e-3  # m of height between start and goal of an object that is dragged
CHECKS = 100_000  # motions checked for the path of the object


class PressedPath:
    """A path on the support, along which hands press on the object."""

    name = "object path dragged from above"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical and several contacts may be used."""
        return task.may_change_contacts and task.subgoal.attached_path is None

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Plan a path on the support and follow it with presses, if friction allows them."""
        context = search.context
        state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
        goal = goal_of_round(context, task, state)
        start, scene = state.poses[task.object], context.scene
        ends = np.array([start, goal.pose])
        level = float(np.ptp(ends[:, 2])) < LEVEL
        if not level or not any(press_of(scene, state, task.object, name, ends).possible for name in scene.robots):
            return context.record.last_failure()
        fixed = replace(path_scene(scene, task), motion="planar", removable={})
        query = ObjectPathQuery(fixed, state, goal, context.seed(), context.time_left(), CHECKS)
        try:
            poses = context.components.object_path.plan_path(query).poses
        except NoObjectPath as error:
            return Failure.of(error)
        return search.follow(replace(task.subgoal, pressed=True), task.sequence, poses)
