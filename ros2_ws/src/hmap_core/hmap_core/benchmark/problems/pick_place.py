"""Pick a box and place it behind a wall. The path leads over or around the wall."""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, panda, sampled, table, transfer_motion, yaw_quaternion
from hmap_core.benchmark.sampling import ends_are_free
from hmap_core.transforms import from_rpy, pose
from hmap_core.types import BodyKind, Goal

BOX, WALL = "box", "wall"
STEPS = (30, 30)
WIDTH = (0.04, 0.06)  # m of the box, both ways
HEIGHT = (0.08, 0.16)  # m of the box
GRASP_DEPTH = 0.025  # m from the top of the box down to the end-effector
FINGER_ROOM = 0.008  # m to either side of the box
AHEAD = (0.4, 0.6)  # m; distance of the box in front of the robot
ASIDE = (0.12, 0.3)  # m from the wall, on either side of it
WALL_SIZE = ((0.2, 0.02, 0.15), (0.4, 0.03, 0.3))  # m
WALL_AHEAD = (0.45, 0.6)  # m
APPROACH_STEPS = 4  # the last ones of the first phase, straight down
APPROACH = 0.06  # m
LIFT_STEPS = 4  # in which the box moves straight up from the table, or down to it
LIFT = 0.05  # m
ROUNDING = 0.005  # m


def pick_place(seed: int) -> MotionInstance:
    """Pick and place with sharp edges."""
    return sampled(_sample_instance, "pick_place", seed)


def pick_place_rounded(seed: int) -> MotionInstance:
    """The same with rounded edges."""
    return replace(pick_place(seed), rounding=ROUNDING)


def _sample_instance(seed: int, rng: np.random.Generator) -> MotionInstance | None:
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
    opening = min(size[1] + 2 * FINGER_ROOM, robot.model.require_gripper().open_opening)
    bodies = [table(), box(BOX, size, start, BodyKind.MOVABLE), wall]
    scene = scene_of("pick_place", seed, bodies, [robot], Goal(BOX, goal))
    attachment = Attachment(robot.name, BOX, 1, contact)
    if not ends_are_free(scene, opening, attachment, goal, rng, SAFE):
        return None
    approach, lift = (APPROACH, APPROACH_STEPS), (LIFT, LIFT_STEPS)
    return transfer_motion(scene, opening, STEPS, attachment, goal, approach, seed, False, lift)
