"""Whether the robots of a scene can move a body at all, by its weight."""

from collections.abc import Iterable

import numpy as np

from hmap_core.contacts.grip_force import lifting_problem, sliding_problem
from hmap_core.contacts.shared_load import PAYLOAD_SHARE, capacity
from hmap_core.types import Goal, Scene, TaskMode

LIFTED = 1e-3  # m between start and goal, beyond the tolerance of the goal, for which a body has to be lifted
TILTED = float(np.deg2rad(1.0))  # rad of tilt between them, likewise


def has_to_be_lifted(T_start: np.ndarray, goal: Goal) -> bool:
    """Whether a body has to leave its support on the way from T_start (7,) to a goal: it changes height or tilt."""
    return changes_height(T_start, goal) or tilts(T_start, goal)


def changes_height(T_start: np.ndarray, goal: Goal) -> bool:
    """Whether a goal is higher or lower than T_start (7,) by more than its tolerance allows."""
    return bool(abs(goal.pose[2] - T_start[2]) > LIFTED + goal.position_tolerance)


def tilts(T_start: np.ndarray, goal: Goal) -> bool:
    """Whether the vertical of a body at a goal is another one than at T_start (7,)."""
    tilt = np.arccos(np.clip(_up(T_start) @ _up(goal.pose), -1.0, 1.0))
    return bool(tilt > TILTED + goal.rotation_tolerance)


def weight_problem(scene: Scene, object: str, robots: Iterable[str], lifted: bool) -> str:
    """Why none of the robots can move a body, by its weight alone; empty if one can, and in a kinematic task.

    Args:
        scene: the task.
        object: name of the body.
        robots: names of robots.
        lifted: whether the body has to be lifted; otherwise it may slide on its support.
    """
    if scene.mode == TaskMode.KINEMATIC:
        return ""
    body, problems = scene.bodies[object], []
    for name in robots:
        model = scene.robots[name].model
        problem = lifting_problem(body, name, model) if lifted else sliding_problem(body, name, model)
        if not problem:
            return ""
        problems.append(problem)
    if not problems:
        return ""
    verb = "lift" if lifted else "move"
    return f"'{object}' weighs {body.mass:.4g} kg, which no robot can {verb}: {'; '.join(problems)}"


def shared_problem(scene: Scene, object: str) -> str:
    """Why no two robots can carry a body together, by its weight alone; empty if two can."""
    body = scene.bodies[object]
    able = {name: capacity(body, robot.model) for name, robot in scene.robots.items() if robot.model.gripper}
    if len(able) < 2:
        return "there is no second robot with a gripper that could carry a part of it"
    if scene.motion == "planar":
        return "two robots cannot lift it together, since the task's motion is planar"
    best = sorted(able, key=lambda name: -able[name])[:2]
    if body.mass <= PAYLOAD_SHARE * sum(able[name] for name in best):
        return ""
    each = " and ".join(f"'{name}' {able[name]:.3g} kg" for name in best)
    return f"two robots together carry too little as well: {each}"


def needs_two_robots(scene: Scene, object: str, T_start: np.ndarray, goal: Goal) -> bool:
    """Whether no robot can move a body from T_start (7,) to a goal alone, by its weight, and two might."""
    if len(scene.robots) < 2 or scene.mode == TaskMode.KINEMATIC:
        return False
    return bool(_alone(scene, object, T_start, goal)) and not shared_problem(scene, object)


def no_robot_moves(scene: Scene, object: str, T_start: np.ndarray, goal: Goal) -> str:
    """Why neither one robot nor two can move a body from T_start (7,) to a goal, by its weight; empty if they can."""
    problem = _alone(scene, object, T_start, goal)
    if not problem or len(scene.robots) < 2:
        return problem
    together = shared_problem(scene, object)
    return together and f"{problem}; {together}"


def _alone(scene: Scene, object: str, T_start: np.ndarray, goal: Goal) -> str:
    """Why no robot can move a body alone, by its weight."""
    lifted = has_to_be_lifted(T_start, goal)
    problem = weight_problem(scene, object, scene.robots, lifted)
    if problem and not lifted:  # it may be lifted instead
        problem = weight_problem(scene, object, scene.robots, True) and problem
    return problem


def _up(T: np.ndarray) -> np.ndarray:
    """The world's vertical (3,) in the frame of a body at T (7,)."""
    x, y, z, w = T[3:]
    return np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
