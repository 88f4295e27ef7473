"""Paths made of pushes, each on one side of the object (Lynch & Mason, IJRR 1996)."""

from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.push_path import PushPlanner
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.surroundings import PHYSICAL_MIN_DISTANCE, placed_bodies
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.types import Scene, SceneState
from hmap_core.waypoints import ObjectPathProblem

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

VARIANTS = 3  # of paths made of pushes, for one object path


def push_planner(scene: Scene, state: SceneState, object: str, poses: np.ndarray) -> PushPlanner:
    """The planner of pushes from the first to the last of poses (M, 7) of an object."""
    around = placed_bodies(scene, state, object)
    return PushPlanner(
        ObjectPathProblem(scene.bodies[object], poses[0], poses[-1], around, min_distance=PHYSICAL_MIN_DISTANCE)
    )


class PushedPaths:
    """The last object path, replaced by pushes. Few paths can be pushed as they are found."""

    name = "object path made of pushes"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical, there is a free path, and several contacts may be used along it."""
        return task.ready is not None and task.may_slide

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Follow up to VARIANTS different paths of pushes."""
        context = search.context
        ready = task.require_ready()
        state = with_tool_placed(ready.state, ready.tool_grasp)
        pushes, known = push_planner(context.scene, state, task.object, task.poses), [task.poses]
        for variant in range(task.number, task.number + VARIANTS):
            pushed = pushes.path(task.poses, context.rng if variant else None)
            if pushed is None or any(np.array_equal(pushed, other) for other in known):
                continue
            known.append(pushed)
            with context.record.tree.attempt(f"{len(pushed)} poses"):
                outcome = search.follow(task.subgoal, ready, pushed)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
            task.stopped(outcome, pushed)
        return context.record.last_failure()
