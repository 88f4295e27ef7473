"""The other order: a contact first, then a path for the object and the hand that holds it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.planner.attached_path import attached_paths
from hmap_core.planner.contact_filters import NoneServes
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.interfaces import AttachedPath
from hmap_core.planner.obstacle_removal import BlockedError, RemovalError
from hmap_core.planner.obstruction import without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.strategies.remove_obstacles import clear_path, removable_load
from hmap_core.planner.surroundings import nearest_first
from hmap_core.planner.tasks import EndGrasp, PathTask
from hmap_core.planner.tools import with_tool_placed

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

HANDS_TRIED = 3  # contacts of a robot for which a path is planned


class AttachedPathStrategy:
    """Paths of the object and a hand as one rigid body, for contacts that serve at the start and at the goal."""

    name = "path of the object with a hand attached"

    def applies(self, task: PathTask) -> bool:
        """Always."""
        return True

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try the contacts of the nearest robot first."""
        record, context = search.context.record, search.context
        load = removable_load(path_scene(context.scene, task), task)
        for path in self._paths(context, task, load):
            record.counts["waypoint_plans"] += 1
            subgoal = replace(task.subgoal, attached_path=path)
            with record.tree.attempt(f"hand of {path.robot}, path of {len(path.poses)} poses"):
                cleared = clear_path(search, subgoal, task.sequence, path.poses, (*load, *path.blockers))
                if isinstance(cleared, Failure):
                    if isinstance(cleared.error, RemovalError):
                        record.failed(cleared.error)
                    if isinstance(cleared.error, BlockedError):
                        task.blocked = cleared
                    continue
                outcome = search.follow(subgoal, cleared.sequence, path.poses, cleared.known)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
        return record.last_failure()

    def _paths(self, context: SearchContext, task: PathTask, load: tuple[str, ...]) -> Iterator[AttachedPath]:
        """Such paths, of one robot after the other, once the ``load`` of the object is gone."""
        object, state = task.object, with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
        goal, scene = goal_of_round(context, task, state), without(path_scene(context.scene, task), load)
        context.report("waypoints", text=f"path of '{object}' with a hand attached {task.subgoal.reason}")
        bare = without(scene, scene.removable)  # of the load, too
        # an obstacle that hands can take, but not bring there, has other places
        thorough = task.subgoal.depth == 0 or not isinstance(context.record.error, NoneServes)
        for robot in nearest_first(scene, object, state, tuple(scene.robots)):
            contacts = context.components.end_contacts.find(
                bare, state, object, goal.pose, robot, HANDS_TRIED, context.seed(), thorough
            )
            hands = [(robot, contact) for contact in contacts]
            task.hands += [EndGrasp(robot, contact, goal.pose) for contact in contacts]
            planner = context.components.object_path
            yield from attached_paths(planner, scene, state, goal, hands, context.rng, context.time_left())
