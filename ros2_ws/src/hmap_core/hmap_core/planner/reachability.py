"""Why an object cannot be brought to its goal: whether any robot could move it there, or from where it starts."""

import numpy as np

from hmap_core.contacts.grip_width import grip_problem
from hmap_core.contacts.push_path import final_pushes, first_pushes
from hmap_core.exceptions import Code, ContactError
from hmap_core.planner.context import SearchContext
from hmap_core.planner.diagnosis import (
    PUSHED_STEPS,
    hand_fits,
    hand_fits_at_goal,
    overlapped,
    why_no_contact,
    why_not_moved,
)
from hmap_core.planner.goals import about_vertical, goal_of_round
from hmap_core.planner.obstruction import without
from hmap_core.planner.protocols import ContactSearchQuery
from hmap_core.planner.sampled_presses import press_finder
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tilt import SAME_TILT, keeps_tilt, never_tilts, tilt_and_yaw
from hmap_core.planner.tools import attach_tool, extent, tools_of, with_tool_placed
from hmap_core.types import Goal, Scene, SceneState, TaskMode

GOAL_POSES = 4  # last poses of the object's path at which the goal has to be within reach
SAMPLINGS = 2  # of contacts without success, after which the goal counts as out of reach
TURNS = 2  # of an object that slides, in which its goal is checked, too
LEVEL_PATH = 1e-3  # m that a path may rise if the object slides
GRASPS_TRIED = 6  # on tools


def check_goal(context: SearchContext, task: PathTask) -> None:
    """Check whether the goal of the task's object is within reach, once no contact was found along a path to it.

    Raises:
        ContactError: OUT_OF_REACH; no robot could bring the object along the last poses, whatever the way there.
    """
    goal, scene = task.subgoal.goal, context.scene
    if task.subgoal.depth > 0 or context.record.code != Code.NO_CONTACT:
        return
    if keeps_tilt(scene) and tilt_and_yaw(task.poses[-1], task.poses[-min(GOAL_POSES, len(task.poses))])[0] > SAME_TILT:
        return  # an arm with few joints may tilt the object about another axis
    there = with_tool_placed(context.start, context.start_grasp).copy()
    bare = without(scene, scene.removable.keys() - {goal.object})
    failure: ContactError | None = None
    for poses in _ways_in(context, goal.object, task.poses[-GOAL_POSES:]):
        there.poses[goal.object] = poses[0]
        query = context.contact_search(bare, there, goal.object, poses, scene.robots, 1)
        try:
            context.components.contacts.find_contacts(query)
            return
        except ContactError as error:
            failure = error
        if _pressed(context, query) or _tool_reaches(context, bare, there, goal.object, poses):
            return
    place = ", ".join(f"{v:.3f}" for v in goal.pose[:3])
    raise ContactError(
        f"the goal of '{goal.object}' at ({place}) is out of reach of {', '.join(scene.robots)}: "
        f"no contact can bring it there: {why_no_contact(bare, there, goal.object, goal.pose)}",
        Code.OUT_OF_REACH,
    ) from failure


def check_tilt(context: SearchContext, goal: Goal) -> None:
    """Check whether the object has to be tilted, and some robot can.

    Raises:
        ContactError: OUT_OF_REACH; it has to, and all hands turn about the vertical only.
    """
    tilt = tilt_and_yaw(context.start.poses[goal.object], goal.pose)[0]
    if tilt > goal.rotation_tolerance + SAME_TILT and never_tilts(context.scene):
        raise ContactError(
            f"the goal of '{goal.object}' is tilted by {np.degrees(tilt):.1f} deg from where it stands; allowed are "
            f"{np.degrees(goal.rotation_tolerance):.1f} deg, for the hands of {', '.join(context.scene.robots)} "
            "turn about the vertical only",
            Code.OUT_OF_REACH,
        )


def check_start(context: SearchContext, task: PathTask) -> None:
    """Check whether a hand fits on the task's object where it starts, once no contact was found along a path.

    By the hands alone, whatever is removable being gone; in scenes with tools, by those as well.

    Raises:
        ContactError: NO_CONTACT; no hand fits, for a grasp, for a push on any side, or for a press.
    """
    object, scene = task.subgoal.goal.object, context.scene
    if task.subgoal.depth > 0 or context.record.code != Code.NO_CONTACT or scene.mode == TaskMode.KINEMATIC:
        return
    bare = without(scene, scene.removable.keys() - {object})
    start = with_tool_placed(context.start, context.start_grasp)
    if hand_fits(bare, start, object) or _tool_moves(context, bare, start, object):
        return
    place = ", ".join(f"{v:.3f}" for v in start.poses[object][:3])
    obstacles = [name for name in scene.removable if name != object]
    even = f", even without {', '.join(repr(name) for name in obstacles)}" if obstacles else ""
    ungrippable = filter(None, (grip_problem(scene, name, scene.robots) for name in obstacles))
    reasons = "; ".join((why_not_moved(bare, start, object), *_too_short(bare, object), *ungrippable))
    raise ContactError(f"no contact can move '{object}' from its start at ({place}){even}: {reasons}", Code.NO_CONTACT)


def check_hand_at_goal(context: SearchContext, task: PathTask) -> None:
    """Check whether a hand fits on the task's object at its goal, by the hands alone, whatever is removable being gone.

    Scenes with tools are not checked.

    Raises:
        ContactError: OUT_OF_REACH; no hand can release the object there, nor push or drag it there.
    """
    goal, scene = task.subgoal.goal, context.scene
    if task.subgoal.depth > 0 or scene.mode == TaskMode.KINEMATIC or tools_of(scene, goal.object):
        return
    bare = without(scene, scene.removable.keys() - {goal.object})
    pose = goal_of_round(context, task, context.start).pose
    if hand_fits_at_goal(bare, context.start, goal.object, pose):
        return
    place = ", ".join(f"{v:.3f}" for v in pose[:3])
    raise ContactError(
        f"the goal of '{goal.object}' at ({place}) is out of reach of {', '.join(scene.robots)}: no hand fits on it "
        f"there, to release it or to push it: {why_no_contact(bare, context.start, goal.object, pose)}; "
        "move the goal, leave more room for the hand there, or add a tool",
        Code.OUT_OF_REACH,
    )


def _tool_moves(context: SearchContext, scene: Scene, state: SceneState, object: str) -> bool:
    """Whether some tool in some hand could begin to push or pull an object on one of its sides."""
    if not tools_of(scene, object):
        return False
    ways = first_pushes(scene.bodies[object], state.poses[object], PUSHED_STEPS)
    ways = [way for way in ways if not overlapped(scene, state, object, way[-1])]
    return any(_tool_reaches(context, scene, state, object, way) for way in ways or [state.poses[object][None]])


def _too_short(scene: Scene, object: str) -> list[str]:
    """What is said of tools with which an object cannot be moved."""
    lengths = [f"'{name}' ({2e3 * extent(scene, name):.0f} mm across)" for name in tools_of(scene, object)]
    return [f"no tool reaches it either: {', '.join(lengths)}; a longer or thinner tool may"] if lengths else []


def _ways_in(context: SearchContext, object: str, last_poses: np.ndarray) -> list[np.ndarray]:
    """Last poses (M, 7) of paths to the goal: the given ones, and pushes on each side of the object, turned or not.

    The directions in which it can be pushed depend on its yaw; whether hands reach the goal does not.
    """
    ways = [last_poses] * SAMPLINGS
    if context.scene.mode == TaskMode.KINEMATIC or np.ptp(last_poses[:, 2]) > LEVEL_PATH:
        return ways
    turns = 0 if keeps_tilt(context.scene) else TURNS  # frames of arms with few joints are searched, which takes long
    for turn in [0.0, *context.rng.uniform(-np.pi, np.pi, turns)]:
        ways += final_pushes(context.scene.bodies[object], about_vertical(last_poses[-1], turn), len(last_poses))
    return ways


def _pressed(context: SearchContext, query: ContactSearchQuery) -> bool:
    """Whether a hand could drag the object from above along the poses of a query."""
    try:
        press_finder(context.components.checker).find_contacts(query)
        return True
    except ContactError:
        return False


def _tool_reaches(context: SearchContext, scene: Scene, state: SceneState, object: str, poses: np.ndarray) -> bool:
    """Whether some tool in some hand could bring an object along poses (M, 7)."""
    if not tools_of(scene, object):
        return False
    grasps = context.components.tools.tool_grasps(scene, state, object, poses, context.seed(), context.time_left())
    for grasp, _ in grasps[:GRASPS_TRIED]:
        query = context.contact_search(attach_tool(scene, grasp), state, object, poses, (grasp.robot,), 1)
        try:
            context.components.contacts.find_contacts(query)
            return True
        except ContactError:
            continue
    return False
