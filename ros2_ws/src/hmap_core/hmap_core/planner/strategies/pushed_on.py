"""Pushes from where pushes on another path have brought the object."""

from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.hand import hand_of
from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.waypoints import NoObjectPath

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TIMES = 4  # that the object is pushed on before another object path is planned
VARIANTS = 3  # of paths made of pushes from one place
CHECKS = 20_000  # motions checked for the path of the object


class PushedOn:
    """Plans anew where a path of pushes could not be followed any more, instead of from the start."""

    name = "pushed on from there"

    def applies(self, task: PathTask) -> bool:
        """Whether pushes have brought the object on, and several contacts may be used."""
        return task.reached is not None and task.may_slide

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Push on from place to place, as long as the object comes on; only what no hand grips."""
        context, record = search.context, search.context.record
        hands = [hand_of(robot) for robot in context.scene.robots.values()]
        sequence, task.reached = task.reached, None
        body = context.scene.bodies[task.object]
        if sequence is None or grippable(body, sequence.state.poses[task.object], hands):
            return record.last_failure()
        for _ in range(TIMES):
            state = with_tool_placed(sequence.state, sequence.tool_grasp)
            scene = replace(path_scene(context.scene, task), motion="planar", removable={})
            goal = goal_of_round(context, task, state)
            query = ObjectPathQuery(scene, state, goal, context.seed(), context.time_left(), CHECKS)
            try:
                poses = context.components.object_path.plan_path(query).poses
            except NoObjectPath:
                break
            pushes, reached = push_planner(context.scene, state, task.object, poses), None
            for variant in range(VARIANTS):
                pushed = pushes.path(poses, context.rng if variant else None)
                if pushed is None:
                    continue
                with record.tree.attempt(f"{len(pushed)} poses"):
                    outcome = search.follow(task.subgoal, sequence, pushed)
                if isinstance(outcome, Solution) or outcome.ends_round:
                    return outcome
                reached = reached or outcome.reached
            if reached is None:
                break
            sequence = reached
        return record.last_failure()
