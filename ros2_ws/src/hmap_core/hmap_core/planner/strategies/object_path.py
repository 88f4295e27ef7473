"""H-MaP's own order: the path of the object alone, then contacts and motions along it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.grip_width import grip_problem
from hmap_core.exceptions import Code
from hmap_core.planner.contact_filters import NoneServes
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import goal_of_round, path_scene, slides_only
from hmap_core.planner.immovable import first_immovable
from hmap_core.planner.obstacle_removal import StuckError
from hmap_core.planner.obstruction import without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.sampled_contacts import first_direction
from hmap_core.planner.strategies.pushed_paths import pushable_path
from hmap_core.planner.strategies.remove_obstacles import clear_path, removable_load, why_stuck
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import tools_of, with_tool_placed
from hmap_core.types import Goal, Scene, SceneState
from hmap_core.waypoints import NoObjectPath, ObjectPath

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

PATHS_AT_FIRST = 3  # object paths in the first round, as long as they lead to no contact at all
STUCK_ROUND = 1  # round after which it is looked whether the obstacles on the path can be moved at all
TASK_CHECKS = 500_000  # motions checked for one path of the task's object, some 5 s
OBSTACLE_CHECKS = 100_000  # motions checked for the path of an obstacle to one of several places


class ObjectPathStrategy:
    """The path of the object alone; obstacles on it are removed first."""

    name = "object path"

    def applies(self, task: PathTask) -> bool:
        """Always."""
        return True

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Plan a path and follow it; in the first round further paths, as long as they lead to no contact.

        For an obstacle that is removed alone, other places come before other paths.

        The failure ends the round if there is no path, or if an obstacle on it cannot be removed.
        """
        context = search.context
        seen: list[np.ndarray] = []
        counts = context.record.counts
        outcome: Outcome = context.record.last_failure()
        tries = counts["contact_tries"]
        for _ in range(PATHS_AT_FIRST if task.number == 0 and not task.subgoal.alone else 1):
            context.report("waypoints", text=f"path of '{task.object}' {task.subgoal.reason}")
            try:
                task.poses, blockers = _plan(context, task)
            except NoObjectPath as error:
                if not seen:
                    return Failure.of(_with_grip(error, context.scene, task), ends_round=True)
                break
            if any(np.array_equal(task.poses, other) for other in seen):
                continue  # the next path may differ
            seen.append(task.poses)
            counts["waypoint_plans"] += 1
            outcome = self._follow(search, task, blockers)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
            task.stopped(outcome, task.poses)
            if blockers or counts["contact_tries"] > tries or _no_grasp(context.scene, task, outcome):
                break
        return outcome

    def _follow(self, search: "Search", task: PathTask, blockers: tuple[str, ...]) -> Outcome:
        what = f", with {', '.join(blockers)} in the way" if blockers else ""
        with search.context.record.tree.attempt(f"path of {len(task.poses)} poses{what}") as node:
            task.ready = None
            wide = [name for name in blockers if grip_problem(search.context.scene, name, search.context.scene.robots)]
            if wide and task.number == 0 and task.subgoal.depth == 0:
                stuck = _immovable(search, task, wide)
                if stuck is not None:
                    node.fail(stuck.stage, stuck.code, stuck.reason)
                    return Failure.of(stuck, ends_round=True)
            cleared = clear_path(search, task.subgoal, task.sequence, task.poses, blockers)
            if isinstance(cleared, Failure):
                return self._unless_stuck(search, task, blockers, cleared)
            task.ready = cleared.sequence
            return search.follow(task.subgoal, cleared.sequence, task.poses, cleared.known)

    def _unless_stuck(self, search: "Search", task: PathTask, blockers: tuple[str, ...], failure: Failure) -> Failure:
        """The failure of a path with obstacles on it; that of the obstacles if nothing can move them.

        In the first round only what is known by weight, and by the hand alone.
        """
        looks = task.number <= STUCK_ROUND and task.subgoal.depth == 0 and task.sequence.tool_grasp is None
        if not (blockers and looks) or failure.ends_round:
            return failure
        with search.context.record.tree.attempt(f"whether {', '.join(blockers)} can be moved") as node:
            stuck = (why_stuck if task.number == STUCK_ROUND else _immovable)(search, task, blockers)
            if stuck is None:
                node.succeed()
                return failure
            node.fail(stuck.stage, stuck.code, stuck.reason)
        return Failure.of(stuck, ends_round=True)


def _no_grasp(scene: Scene, task: PathTask, failure: Failure) -> bool:
    """Whether no hand has a contact where a path begins that lifts; other paths would begin with the same grasps."""
    unreached = failure.at == 0 and failure.code == Code.NO_CONTACT and not isinstance(failure.error, NoneServes)
    if not unreached or task.kinematic or tools_of(scene, task.object):
        return False
    direction = first_direction(task.poses)
    return direction is not None and direction[2] > 0.0


def _with_grip(error: NoObjectPath, scene: Scene, task: PathTask) -> NoObjectPath:
    """The failure, and why the object cannot be lifted over what is in its way."""
    if scene.motion == "planar" or not slides_only(scene, task):
        return error
    why = grip_problem(scene, task.object, scene.robots)
    reason = f"{error.reason}; it cannot be lifted over that: {why}"
    return NoObjectPath(reason, error.blockers, error.free_without, error.path_without, error.proven)


def _immovable(search: "Search", task: PathTask, blockers: Sequence[str]) -> StuckError | None:
    found = first_immovable(search.context, task, blockers)
    if found is None:
        return None
    name, why = found
    reason = f"'{name}' is in the way of '{task.object}' and cannot be removed: nothing can move '{name}': {why}"
    return StuckError(reason, Code.NO_CONTACT)


def _plan(context: SearchContext, task: PathTask) -> tuple[np.ndarray, tuple[str, ...]]:
    """Poses (M, 7) of the object on a path to its goal, and the removable bodies that are in its way.

    What stands on the object is in its way, too.

    Raises:
        NoObjectPath: there is no path, even without the removable bodies.
    """
    state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
    goal = goal_of_round(context, task, state)
    scene = path_scene(context.scene, task)
    load = removable_load(scene, task)
    scene = without(scene, load)
    checks = TASK_CHECKS if task.subgoal.depth == 0 else OBSTACLE_CHECKS
    try:
        poses = _object_path(context, scene, state, goal, checks).poses
        if task.number % 2:
            return poses, load  # every second round as it is
        rng = context.rng if task.number else None
        return pushable_path(scene if load else context.scene, state, task.subgoal.goal, poses, rng), load
    except NoObjectPath as error:
        if not error.free_without:
            raise
        blockers, path = error.free_without, error.path_without
    if path is None:
        path = _object_path(context, without(scene, blockers), state, goal, checks)
    return path.poses, (*load, *blockers)


def _object_path(context: SearchContext, scene: Scene, state: SceneState, goal: Goal, checks: int) -> ObjectPath:
    query = ObjectPathQuery(scene, state, goal, context.seed(), context.time_left(), checks)
    try:
        return context.components.object_path.plan_path(query)
    except NoObjectPath:
        context.time_left()  # raises: a search without time left says nothing about the path
        raise
