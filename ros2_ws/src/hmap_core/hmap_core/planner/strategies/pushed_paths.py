"""Paths made of pushes, each on one side of the object (Lynch & Mason, IJRR 1996)."""

from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.few_pushes import two_pushes
from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.hand import hand_of
from hmap_core.contacts.push_path import PushPlanner
from hmap_core.planner.goals import GOAL_SHARE
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.surroundings import PHYSICAL_MIN_DISTANCE, placed_bodies
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.types import Goal, Scene, SceneState, TaskMode
from hmap_core.waypoints import ObjectPathProblem

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

VARIANTS = 3  # of paths made of pushes, for one object path
FEW = 2  # pushes; where a path needs more, one to another orientation of the object is looked for


def push_planner(scene: Scene, state: SceneState, object: str, poses: np.ndarray) -> PushPlanner:
    """The planner of pushes from the first to the last of poses (M, 7) of an object."""
    around = placed_bodies(scene, state, object)
    return PushPlanner(
        ObjectPathProblem(scene.bodies[object], poses[0], poses[-1], around, min_distance=PHYSICAL_MIN_DISTANCE)
    )


def pushable_path(
    scene: Scene, state: SceneState, goal: Goal, poses: np.ndarray, rng: np.random.Generator | None = None
) -> np.ndarray:
    """A path made of pushes in place of one of an object that no hand can grip; else the path as it is.

    Args:
        scene, state: the world, and where everything is.
        goal: of the object; its tolerance may leave the orientation open.
        poses: (M, 7) path of the object, world frame.
        rng: of other paths than the one with the fewest pushes; None: that one.
    """
    body = scene.bodies[goal.object]
    if scene.mode == TaskMode.KINEMATIC or grippable(body, poses[0], map(hand_of, scene.robots.values())):
        return poses
    pushes = push_planner(scene, state, goal.object, poses)
    pushed = pushes.path(poses, rng)
    if pushed is not None and pushes.legs > FEW and rng is None:
        fewer = two_pushes(pushes, poses, goal.pose, GOAL_SHARE * goal.rotation_tolerance)
        pushed = pushed if fewer is None else fewer
    return poses if pushed is None else pushed


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
