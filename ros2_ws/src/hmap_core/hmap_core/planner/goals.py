"""Goals and scenes of one round of the outer loop: variations that the tolerances of a task allow."""

from dataclasses import replace

import numpy as np

from hmap_core.contacts.grip_width import grip_problem
from hmap_core.planner.context import SearchContext
from hmap_core.planner.loads import has_to_be_lifted
from hmap_core.planner.solution_sequence import removable_for
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tilt import keeps_tilt, levelled
from hmap_core.transforms import inverse, multiply, quaternion_multiply
from hmap_core.types import Goal, Scene, SceneState, TaskMode

GOAL_SHARE = 0.5  # of the goal's tolerance that a plan may use so that the object need not be turned
GOAL_TURN = float(np.deg2rad(45.0))  # rad by which the goal is turned at most, where its tolerance allows it
LEVEL = 1e-3  # rad of tilt that does not count


def goal_of_round(context: SearchContext, task: PathTask, state: SceneState) -> Goal:
    """The goal of a subgoal in one round.

    The object keeps its orientation if half of the rotation tolerance allows it: a body that turns on its way is hard
    to push. If no robot can change the tilt of its hand, the object keeps its own, as far as that half allows it. Later
    rounds of a physical task turn the goal at random, which changes the directions of possible pushes.
    """
    goal = unturned(task.subgoal.goal, state.poses[task.object])
    if keeps_tilt(context.scene):
        goal = levelled(goal, state.poses[task.object], GOAL_SHARE)
    if task.number > 0 and context.scene.mode != TaskMode.KINEMATIC:
        goal = turned(goal, context.rng.uniform(-1.0, 1.0))
    return goal


def path_scene(scene: Scene, task: PathTask) -> Scene:
    """The scene in which the object's path is planned.

    If sliding and lifting are both allowed, as they are for obstacles, every second round lifts; what no gripper holds
    slides. Only those bodies are removable that the subgoal may move.
    """
    motion = scene.motion if task.subgoal.depth == 0 else "auto"
    if motion == "auto" and slides_only(scene, task):
        motion = "planar"
    if motion == "auto" and task.number % 2 == 1:
        motion = "spatial"
    removable = {name: scene.removable[name] for name in removable_for(scene, task.subgoal, task.sequence)}
    return replace(scene, motion=motion, removable=removable)


def slides_only(scene: Scene, task: PathTask) -> bool:
    """Whether an object has to slide to its goal, at the same height and tilt, as no gripper holds it."""
    goal, start = task.subgoal.goal, task.sequence.state.poses[task.object]
    return not has_to_be_lifted(start, goal) and bool(grip_problem(scene, task.object, scene.robots))


def unturned(goal: Goal, T_start: np.ndarray) -> Goal:
    """The goal with the object turned about the vertical as at T_start (7,), if half the tolerance allows it."""
    turn = multiply(np.r_[np.zeros(3), goal.pose[3:]], inverse(np.r_[np.zeros(3), T_start[3:]]))
    angle = 2.0 * np.arccos(np.clip(abs(turn[6]), 0.0, 1.0))
    tilt = 2.0 * np.arcsin(min(1.0, float(np.hypot(turn[3], turn[4]))))
    if angle > GOAL_SHARE * goal.rotation_tolerance or tilt > LEVEL:
        return goal
    return replace(goal, pose=np.concatenate([goal.pose[:3], T_start[3:]]))


def turned(goal: Goal, share: float) -> Goal:
    """The goal turned about the vertical by a share in [-1, 1] of GOAL_TURN, if half the tolerance allows that."""
    if GOAL_SHARE * goal.rotation_tolerance < GOAL_TURN:
        return goal
    return replace(goal, pose=about_vertical(goal.pose, share * GOAL_TURN))


def about_vertical(T: np.ndarray, angle: float) -> np.ndarray:
    """A pose (7,) turned in place about the world's z axis by an angle (rad)."""
    turn = np.array([0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)])
    return np.concatenate([T[:3], quaternion_multiply(turn, T[3:])])
