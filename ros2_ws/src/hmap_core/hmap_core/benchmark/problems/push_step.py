"""Reach a pushing contact on a box on the table, then push it 5 to 15 cm; the box never leaves the table."""

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, TABLE, panda, sampled, table, transfer_motion, yaw_quaternion
from hmap_core.benchmark.sampling import contact_pose, ends_are_free, hand_axes
from hmap_core.transforms import apply, pose
from hmap_core.types import BodyKind, Goal, Robot

BOX = "box"
STEPS = (10, 10)
SIZE = ((0.06, 0.06, 0.06), (0.14, 0.14, 0.14))  # m
DISTANCE = (0.4, 0.6)  # m of the box from the robot
BEARING = np.pi / 4  # rad to either side of the robot's front
PUSH = (0.05, 0.15)  # m
SIDEWAYS = np.deg2rad(30.0)  # between the push and the inward normal
TURN = np.deg2rad(20.0)  # of the box
TILT = (np.deg2rad(30.0), np.deg2rad(60.0))  # of the hand, from the normal's direction towards straight down
AROUND = 0.7  # share of a face in which contacts lie
OBSTACLES = 4
OBSTACLE_SIZE = ((0.04, 0.04, 0.05), (0.12, 0.12, 0.3))  # m
OBSTACLE_REGION = ((0.2, -0.6), (0.8, 0.6))  # m
OBSTACLE_DISTANCE = 0.13  # m from the box's path, beyond half their widths
APPROACH_STEPS = 2  # the last ones of the first phase, straight along the hand
APPROACH = 0.04  # m


def push_step(seed: int) -> MotionInstance:
    """The box and its obstacles are drawn at random."""
    return sampled(_sample_instance, "push_step", seed)


def face_contact(robot: Robot, size: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A contact T_obj_ee (7,) on a side of a box with these extents (3,), and the inward normal (3,) there."""
    axis, sign = rng.integers(2), rng.choice((-1.0, 1.0))
    normal = np.zeros(3)
    normal[axis] = sign
    point = AROUND * rng.uniform(-0.5, 0.5, 3) * size
    point[axis] = sign * size[axis] / 2
    tilt = rng.uniform(*TILT)
    z = -np.cos(tilt) * normal - np.sin(tilt) * np.array([0.0, 0.0, 1.0])
    return contact_pose(robot, point, normal, hand_axes(z, rng.uniform(-np.pi, np.pi))), -normal


def _sample_instance(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda()
    size = rng.uniform(*SIZE)
    distance, bearing = rng.uniform(*DISTANCE), rng.uniform(-BEARING, BEARING)
    yaw = rng.uniform(-np.pi, np.pi)
    start = pose((distance * np.cos(bearing), distance * np.sin(bearing), size[2] / 2), yaw_quaternion(yaw))
    contact, inward = face_contact(robot, size, rng)
    turn, side, way = rng.uniform(-TURN, TURN), rng.uniform(-SIDEWAYS, SIDEWAYS), rng.uniform(*PUSH)
    direction = apply(pose((0, 0, 0), yaw_quaternion(yaw + side)), inward)
    goal = pose(start[:3] + way * direction, yaw_quaternion(yaw + turn))
    bodies = [table(), box(BOX, size, start, BodyKind.MOVABLE), *_obstacles(start, goal, size, rng)]
    scene = scene_of("push_step", seed, bodies, [robot], Goal(BOX, goal))
    attachment = Attachment(robot.name, BOX, 1, contact, support=TABLE)
    if not ends_are_free(scene, 0.0, attachment, goal, rng, SAFE):
        return None
    return transfer_motion(scene, 0.0, STEPS, attachment, goal, (APPROACH, APPROACH_STEPS), seed, touching=True)


def _obstacles(start: np.ndarray, goal: np.ndarray, size: np.ndarray, rng: np.random.Generator):
    """Boxes on the table beside the path of the pushed box."""
    obstacles = []
    for k in range(OBSTACLES):
        extents = rng.uniform(*OBSTACLE_SIZE)
        place = np.append(rng.uniform(*OBSTACLE_REGION), extents[2] / 2)
        way = start[:2] + np.linspace(0.0, 1.0, 5)[:, None] * (goal - start)[:2]
        apart = np.linalg.norm(way - place[:2], axis=1).min()
        if apart > OBSTACLE_DISTANCE + (np.linalg.norm(extents[:2]) + np.linalg.norm(size[:2])) / 4:
            obstacles.append(box(f"obstacle_{k}", extents, pose(place, yaw_quaternion(rng.uniform(-np.pi, np.pi)))))
    return obstacles
