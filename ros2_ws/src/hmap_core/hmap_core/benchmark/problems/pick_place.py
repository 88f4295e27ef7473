"""Pick a box up and place it behind a wall that has to be gone over or round."""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import MotionInstance, Ride, Target, box, scene_of
from hmap_core.benchmark.problems.common import panda, sampled, table, yaw_quaternion
from hmap_core.benchmark.sampling import drawn_back, free_posture_at
from hmap_core.transforms import from_rpy, multiply, pose
from hmap_core.types import BodyKind, Goal

BOX, WALL = "box", "wall"
STEPS = (30, 30)
WIDTH = (0.04, 0.06)  # m of the box, both ways
HEIGHT = (0.08, 0.16)  # m of the box
GRASP_DEPTH = 0.025  # m from the top of the box down to the end-effector
FINGER_ROOM = 0.008  # m to either side of the box
AHEAD = (0.4, 0.6)  # m, where the box stands before the robot
ASIDE = (0.12, 0.3)  # m from the wall, on either side of it
WALL_SIZE = ((0.2, 0.02, 0.15), (0.4, 0.03, 0.3))  # m
WALL_AHEAD = (0.45, 0.6)  # m
STANDING = -1e-6  # m: the box stands on the table, and at that touches it
RESTARTS = 2
APPROACH_STEPS = 4  # the last ones of the first phase, straight down
APPROACH = 0.06  # m
ROUNDING = 0.005  # m


def pick_place(seed: int) -> MotionInstance:
    return sampled(_attempt, "pick_place", seed)


def pick_place_rounded(seed: int) -> MotionInstance:
    """The same with rounded edges."""
    return replace(pick_place(seed), rounding=ROUNDING)


def _attempt(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda()
    size = np.array([*rng.uniform(*WIDTH, 2), rng.uniform(*HEIGHT)])
    wall_size = rng.uniform(*WALL_SIZE)
    wall = box(WALL, wall_size, pose((rng.uniform(*WALL_AHEAD), 0.0, wall_size[2] / 2)))
    side = rng.choice((-1.0, 1.0))
    yaws = rng.uniform(-np.pi / 4, np.pi / 4, 2)
    start, goal = (
        pose((rng.uniform(*AHEAD), s * rng.uniform(*ASIDE), size[2] / 2), yaw_quaternion(yaw))
        for s, yaw in zip((side, -side), yaws, strict=True)
    )
    # from above, closing along the y axis of the box
    contact = from_rpy((0.0, 0.0, size[2] / 2 - GRASP_DEPTH), (np.pi, 0.0, rng.choice((0.0, np.pi))))
    opening = {robot.name: min(size[1] + 2 * FINGER_ROOM, robot.model.gripper.open_opening)}
    near = robot.q
    for T in (start, goal):
        there = [table(), box(BOX, size, T, BodyKind.MOVABLE), wall]
        scene = scene_of("pick_place", seed, there, [robot], Goal(BOX, goal))
        near = free_posture_at(scene, opening, robot.name, multiply(T, contact), rng, STANDING, near)
        if near is None:
            return None
    bodies = [table(), box(BOX, size, start, BodyKind.MOVABLE), wall]
    scene = scene_of("pick_place", seed, bodies, [robot], Goal(BOX, goal))
    targets = (
        Target(robot.name, 0, multiply(start, drawn_back(contact, APPROACH)), APPROACH_STEPS),
        Target(robot.name, 0, multiply(start, contact)),
        Target(robot.name, 1, multiply(goal, contact)),
    )
    ride = Ride(robot.name, BOX, 1, contact)
    return MotionInstance(scene, opening, STEPS, targets, (ride,), restarts=RESTARTS, seed=seed)
