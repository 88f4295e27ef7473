"""A Panda above a table among boxes: a configuration that reaches a 6-D end-effector pose, starting from home."""

from collections.abc import Sequence

import numpy as np

from hmap_core.benchmark.instances import MotionInstance, Target, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, TABLE, panda, sampled, table, yaw_quaternion
from hmap_core.benchmark.sampling import end_effector, random_configuration, surface_contact
from hmap_core.benchmark.world import clearance
from hmap_core.transforms import multiply, pose
from hmap_core.types import Body, BodyKind, Goal, Robot

BOXES = 10
NEAR_BOXES = 5  # of them, around the hand
BOX_SIZE = (0.04, 0.25)  # m
NEAR_OFFSET = 0.3  # m from the hand to the middle of a near box, along each axis
REGION = ((-0.7, -0.7, 0.0), (0.7, 0.7, 0.8))  # m; region of the others
BOX_ATTEMPTS = 60
OPENING = 0.04  # m
LEAST_HEIGHT = 0.05  # m; lowest height of the end-effector above the table
RESTARTS = 20

OBJECT = "object"
OBJECT_SIZE = (0.05, 0.2)  # m
OBJECT_DISTANCE = (0.35, 0.65)  # m from the robot
OBJECT_HEIGHT = (0.0, 0.4)  # m; height of its bottom above the table


def contact_ik(seed: int) -> MotionInstance:
    """The pose is that of a random configuration that the judge finds free, so a solution exists."""
    return sampled(_free_pose, "contact_ik", seed)


def contact_ik_surface(seed: int) -> MotionInstance:
    """The pose is a contact on a box in clutter, with the hand along the inward normal; some poses have no solution."""
    return sampled(_surface, "contact_ik_surface", seed)


def clutter(
    robot: Robot, configurations: Sequence[np.ndarray], centre: np.ndarray, bodies: list[Body], rng
) -> list[Body]:
    """Boxes at random poses, NEAR_BOXES of them around a point (3,), that leave the configurations (n,) free."""
    boxes: list[Body] = []
    for _ in range(BOX_ATTEMPTS):
        if len(boxes) == BOXES:
            break
        near = len(boxes) < NEAR_BOXES
        middle = centre + rng.uniform(-NEAR_OFFSET, NEAR_OFFSET, 3) if near else rng.uniform(*REGION)
        place = pose(middle, rng.normal(size=4))
        new = box(f"box_{len(boxes)}", rng.uniform(*BOX_SIZE, 3), place)
        standing = [body for body in bodies if body.kind is BodyKind.MOVABLE]
        scene = scene_of("clutter", 0, [new, *standing], [robot], Goal(new.name, place))
        if all(clearance(scene, {robot.name: OPENING}, {robot.name: q}, SAFE) >= SAFE for q in configurations):
            boxes.append(new)
    return bodies + boxes


def _instance(name: str, seed: int, robot: Robot, bodies: list[Body], T_world_ee, **others) -> MotionInstance:
    return MotionInstance(
        scene=scene_of(name, seed, bodies, [robot], Goal(TABLE, bodies[0].pose)),
        steps_per_phase=(1,),
        targets=(Target(robot.name, 0, T_world_ee),),
        restarts=RESTARTS,
        path=False,
        seed=seed,
        **others,
    )


def _free_pose(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda()
    q = random_configuration(robot, rng)
    T = end_effector(robot, q)
    bare = scene_of("contact_ik", seed, [table()], [robot], Goal(TABLE, pose()))
    if T[2] < LEAST_HEIGHT or clearance(bare, {robot.name: OPENING}, {robot.name: q}, SAFE) < SAFE:
        return None
    bodies = clutter(robot, [q, robot.q], T[:3], [table()], rng)
    return _instance("contact_ik", seed, robot, bodies, T, opening={robot.name: OPENING})


def _surface(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda()
    distance, bearing = rng.uniform(*OBJECT_DISTANCE), rng.uniform(-np.pi / 2, np.pi / 2)
    size = rng.uniform(*OBJECT_SIZE, 3)
    bottom = rng.uniform(*OBJECT_HEIGHT)
    middle = (distance * np.cos(bearing), distance * np.sin(bearing), bottom + size[2] / 2)
    body = box(OBJECT, size, pose(middle, yaw_quaternion(rng.uniform(-np.pi, np.pi))), BodyKind.MOVABLE)
    scene = scene_of("contact_ik_surface", seed, [body], [robot], Goal(OBJECT, body.pose))
    if clearance(scene, {robot.name: 0.0}, {robot.name: robot.q}, SAFE) < SAFE:
        return None
    T = multiply(body.pose, surface_contact(robot, body, rng))
    bodies = clutter(robot, [robot.q], np.array(middle), [table(), body], rng)
    touching = ((robot.name, OBJECT),)
    return _instance("contact_ik_surface", seed, robot, bodies, T, opening={robot.name: 0.0}, touching=touching)
