"""Removable bodies that nothing can move, known by necessary conditions alone: their weight, and room for a hand."""

from collections.abc import Sequence
from dataclasses import replace

from hmap_core.exceptions import Code, InputError
from hmap_core.planner.context import SearchContext
from hmap_core.planner.diagnosis import hand_fits, why_not_moved
from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.loads import no_robot_moves
from hmap_core.planner.obstruction import stacked_on, without
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import tools_of, with_tool_placed
from hmap_core.types import Goal, Scene, SceneState, TaskMode
from hmap_core.waypoints import NoObjectPath

CHECKS_ROUND = 20_000  # motions checked for a path round a body that nothing can move, some 0.2 s


def why_immovable(scene: Scene, state: SceneState, name: str) -> str:
    """Why no robot can move a body from where it is, whatever else is removable being gone; empty if one may.

    By weight, payload and grip force, by what it carries, and by whether a hand alone fits on it. A tool may reach
    where no hand fits, so scenes with tools are checked for the weight only.

    Args:
        scene: the task.
        state: where everything is, tools being placed.
        name: of the body.
    """
    if scene.mode == TaskMode.KINEMATIC:
        return ""
    heavy = no_robot_moves(scene, name, state.poses[name], Goal(name, state.poses[name]))
    if heavy or tools_of(scene, scene.goal.object):
        return heavy
    stays = [load for load in stacked_on(scene, state, name) if load not in scene.removable]
    if stays:
        return f"'{name}' carries '{stays[0]}', which may not be moved: list it under `removable` in the task"
    bare = without(scene, scene.removable.keys() - {name, scene.goal.object})
    return "" if hand_fits(bare, state, name) else why_not_moved(bare, state, name)


def first_immovable(context: SearchContext, task: PathTask, blockers: Sequence[str]) -> tuple[str, str] | None:
    """The first of some bodies on an object's path that nothing can move, though there is no path round it; and why.

    Args:
        context: the job.
        task: the round.
        blockers: removable bodies on its path.
    """
    state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
    for name in blockers:
        why = why_immovable(context.scene, state, name)
        if why and not _passed_by(context, task, state, name):
            return name, why
    return None


def _passed_by(context: SearchContext, task: PathTask, state: SceneState, name: str) -> bool:
    """Whether the object has a path with a removable body left in its place, and the others gone."""
    scene = path_scene(context.scene, task)
    others = scene.removable.keys() - {name}
    if not others:
        return False
    scene = replace(without(scene, others), removable={})
    query = ObjectPathQuery(
        scene, state, goal_of_round(context, task, state), context.seed(), context.time_left(), CHECKS_ROUND
    )
    try:
        context.components.object_path.plan_path(query)
    except NoObjectPath:
        context.time_left()  # raises: a search without time left says nothing about the path
        return False
    except InputError as error:
        if error.code != Code.GOAL_IN_COLLISION:
            raise
        return False
    return True
