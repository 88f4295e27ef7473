"""Bodies of many parts among obstacles of many parts: generated problems of object paths and whole plans, their times
and limits.
"""

import time
from dataclasses import dataclass

import numpy as np

from hmap_core import planner
from hmap_core.exceptions import HmapError
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.segments import attach_body
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import from_rpy, inverse, multiply, pose
from hmap_core.types import (
    Body,
    BodyKind,
    ContactKind,
    ContactPoint,
    Goal,
    Robot,
    Scene,
    SceneState,
    Shape,
    ShapeKind,
    TaskMode,
)
from hmap_core.waypoints import NoObjectPath, ObjectPathProblem, kernels, plan_waypoints
from hmap_core.waypoints.checker import PENETRATION_ALLOWED, Geometry

WALL = 2.0  # m, side of the wall in which the window is
HOLE = 0.4  # m, side of the window
SIZE = 0.3  # m, length of the bracket's bars
BEYOND = 90.0  # m, extent of the plates beside the wall, which nothing passes
BRICK, BARRIER = (0.04, 0.05, 0.15), (0.5, 0.04, 0.08)  # m, what an arm carries over what
RAISED = 0.02  # m over the table, of a brick that is attached
LIMIT = 60.0  # s, for problems that have a path


@dataclass(frozen=True)
class Trial:
    """One search.

    Attributes:
        cpu, wall: its time, s.
        limit: its time limit, s.
        poses: number of poses of the path, or of samples of the plan; 0 without one.
        clear: whether no pose of the path collides, compared with all pairs of shapes; plans are judged.
    """

    cpu: float
    wall: float
    limit: float
    poses: int
    clear: bool


def bracket(count: int, rng: np.random.Generator) -> Body:
    """A concave body: three bars at right angles, one after the other, of ``count`` small boxes."""
    corners = np.array([[-0.5, -0.5, 0.0], [-0.5, -0.5, 0.0], [0.5, -0.5, 0.0]])
    shapes = []
    for bar, many in enumerate((count - 2 * (count // 3), count // 3, count // 3)):
        for k in range(many):
            at = SIZE * (corners[bar] + np.eye(3)[bar] * (k + 0.5) / many) + rng.normal(0, 0.004, 3)
            shapes.append(_box(rng.uniform(0.01, 0.03, 3), at, rng.standard_normal(4)))
    return Body("bracket", BodyKind.MOVABLE, tuple(shapes), pose(), 1.0)


def window(parts: int, obstacle_parts: int, seed: int, lid: bool = False) -> ObjectPathProblem:
    """A bracket has to pass a window in a wall of many parts, between scattered boxes.

    Args:
        parts: of the bracket.
        obstacle_parts: of the wall and the scattered boxes together; some more close the space beside the wall.
        seed: of the parts' sizes and poses.
        lid: close the window, so that there is no path.
    """
    rng = np.random.default_rng(seed)
    start, goal = np.array([-0.8, 0.3, 0.2]), np.array([0.8, -0.3, -0.1])
    rows = int(np.sqrt(0.77 * obstacle_parts))
    cell = WALL / rows
    grid = (np.arange(rows) + 0.5) * cell - 0.5 * WALL
    wall = [
        _box((0.06, *(cell * rng.uniform(1.0, 1.1, 2))), (rng.normal(0, 0.01), y, z))
        for y in grid
        for z in grid
        if max(abs(y), abs(z)) > 0.5 * (HOLE + cell)
    ]
    scattered: list[Shape] = []
    while len(wall) + len(scattered) < obstacle_parts:
        at = rng.uniform([-1.2, -1, -1], [1.2, 1, 1])
        if all(np.linalg.norm(at - free) > 0.42 for free in (start, goal, 0 * at)):
            scattered.append(_box(rng.uniform(0.02, 0.08, 3), at, rng.standard_normal(4)))
    middle = 0.25 * BEYOND + 0.49 * WALL
    beside = [_box((0.02, BEYOND, 0.5 * BEYOND), (0, 0, s * middle)) for s in (-1, 1)]
    beside += [_box((0.02, 0.5 * BEYOND, BEYOND), (0, s * middle, 0)) for s in (-1, 1)]
    bodies = [("wall", wall), ("boxes", scattered), ("beside", beside), ("lid", [_box((0.02, 1, 1), (0, 0, 0))] * lid)]
    obstacles = tuple(Body(name, BodyKind.FIXED, tuple(shapes), pose()) for name, shapes in bodies if shapes)
    return ObjectPathProblem(
        bracket(parts, rng), pose(start), from_rpy(goal, (1.0, 0.5, -0.7)), obstacles, motion="spatial"
    )


def carried(parts: int, obstacle_parts: int, seed: int) -> Scene:
    """An arm has to carry a brick of many parts over a barrier of many parts.

    Args:
        parts: of the brick, about.
        obstacle_parts: of the barrier, about.
        seed: of where they are.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.47, 0.53), rng.uniform(0.2, 0.27)
    goal = pose((x, y, 0.5 * BRICK[2]))
    table = Body("table", BodyKind.FIXED, (_box((4.0, 4.0, 0.1), (0.0, 0.0, -0.05)),), pose(), 0.0)
    brick = Body("brick", BodyKind.MOVABLE, _grid(BRICK, parts), pose((x, -y, 0.5 * BRICK[2])), 0.3)
    barrier = Body("barrier", BodyKind.FIXED, _grid(BARRIER, obstacle_parts), pose((0.5, 0.0, 0.5 * BARRIER[2])), 0.0)
    model = load_robot_model("panda")
    return Scene(
        task="many parts",
        seed=seed,
        mode=TaskMode.PHYSICAL,
        bodies={body.name: body for body in (table, brick, barrier)},
        robots={"arm": Robot("arm", model, pose(), model.home.copy())},
        cameras={},
        goal=Goal("brick", goal),
    )


def attached(parts: int, obstacle_parts: int, seed: int) -> tuple[Scene, SceneState, list[np.ndarray]]:
    """An arm that has the brick of :func:`carried` attached, at home, has to move it low over the table.

    Returns:
        The scene, the state at the start, and poses (7,) of the end effector before the barrier and beyond it.
    """
    scene = carried(parts, obstacle_parts, seed)
    down = pose((0.0, 0.0, 0.05), (1.0, 0.0, 0.0, 0.0))
    y, z = np.eye(3)[1:]
    grasp = ContactPoint(ContactKind.GRASP, down, np.array([0.0, 0.025, 0.05]), y, BRICK[1], z)
    T_start = scene.bodies["brick"].pose
    state = scene.start_state()
    T_ee = load_arm(scene.robots["arm"].model).end_effector(state.q["arm"])
    state.gripper["arm"], state.poses["brick"] = BRICK[1], multiply(T_ee, inverse(down))
    raised = pose((0.0, 0.0, RAISED))
    return (
        attach_body(scene, "arm", "brick", grasp, T_start),
        state,
        [multiply(multiply(raised, T), down) for T in (T_start, scene.goal.pose)],
    )


def run_transit(scene: Scene, state: SceneState, ends: list[np.ndarray], limit: float = LIMIT) -> Trial:
    """Move what is attached to an arm past the barrier, from before it."""
    before = planner.plan_motion(scene, "arm", T_world_ee=ends[0], state=state, time_limit=max(limit, LIMIT))
    there = state.copy()
    there.q["arm"] = before.trajectory.joints["arm"][-1]
    cpu, wall = time.process_time(), time.monotonic()
    try:
        motion = planner.plan_motion(scene, "arm", T_world_ee=ends[1], state=there, time_limit=limit)
        poses = len(motion.trajectory.time)
    except HmapError:
        poses = 0
    return Trial(time.process_time() - cpu, time.monotonic() - wall, limit, poses, True)


def _grid(size: tuple[float, ...], count: int) -> tuple[Shape, ...]:
    """Boxes, about ``count`` of about the same sides, that fill a box."""
    sides = np.maximum(np.round(np.array(size) * (count / np.prod(size)) ** (1 / 3)), 1).astype(int)
    cell = np.array(size) / sides
    return tuple(_box(cell, (np.array(index) + 0.5) * cell - 0.5 * np.array(size)) for index in np.ndindex(*sides))


def run_plan(scene: Scene, limit: float = LIMIT) -> Trial:
    """Plan a whole task, the judge's verdict included."""
    cpu, wall = time.process_time(), time.monotonic()
    try:
        poses = len(planner.plan(scene, seed=0, time_limit=limit).trajectory.time)
    except HmapError:
        poses = 0
    return Trial(time.process_time() - cpu, time.monotonic() - wall, limit, poses, True)


def _box(size, at, quaternion=(0.0, 0.0, 0.0, 1.0)) -> Shape:
    return Shape(ShapeKind.BOX, tuple(float(side) for side in size), pose(at, quaternion))


def run(problem: ObjectPathProblem, limit: float = LIMIT) -> Trial:
    """Search a path, from the first look at the shapes on."""
    cpu, wall = time.process_time(), time.monotonic()
    try:
        poses = plan_waypoints(problem, np.random.default_rng(0), limit).poses
    except NoObjectPath:
        poses = np.zeros((0, 7))
    cpu, wall = time.process_time() - cpu, time.monotonic() - wall
    return Trial(cpu, wall, limit, len(poses), _clear(problem, poses))


def _clear(problem: ObjectPathProblem, poses: np.ndarray) -> bool:
    geometry = Geometry(problem)
    need = np.full(len(geometry.obstacles.radius), -PENETRATION_ALLOWED)
    arrays = (*geometry.body_arrays, *geometry.obstacles.arrays)
    return all(kernels.blocking(T, *arrays, need, np.zeros(len(need))) < 0 for T in poses)
