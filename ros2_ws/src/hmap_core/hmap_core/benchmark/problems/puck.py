"""A fingertip on the top of a disc carries it over the table, around an obstacle on the straight line."""

from dataclasses import dataclass

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, TABLE, panda, sampled, table, transfer_motion, yaw_quaternion
from hmap_core.benchmark.sampling import contact_pose, ends_are_free, hand_axes
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Goal, Scene, Shape, ShapeKind

DISC, OBSTACLE = "disc", "obstacle"
STEPS = (20, 20)
RADIUS, HEIGHT = (0.04, 0.06), (0.03, 0.05)  # m of the disc
AHEAD = (0.4, 0.55)  # m; distance of start and goal in front of the robot
ASIDE = (0.2, 0.3)  # m of start and goal to its sides
OBSTACLE_SIZE = ((0.05, 0.05, 0.1), (0.12, 0.12, 0.25))  # m
OFF = 0.02  # m; distance of the obstacle from the middle of the straight line
TILT = np.deg2rad(30.0)  # of the hand from upright, at most
AROUND = 0.5  # share of the radius within which contacts lie
APPROACH_STEPS = 3
APPROACH = 0.04  # m


CONTACTS = 20  # number of contacts of the loop


@dataclass(frozen=True)
class LoopInstance:
    """A disc to be moved around an obstacle with any number of contacts.

    Attributes:
        scene: the robot, the table, the disc and the obstacle; its goal is the disc's.
        contacts: T_obj_ee (7,), in the order in which they are tried.
        seed: for the solvers' random numbers.
    """

    scene: Scene
    contacts: tuple[np.ndarray, ...]
    seed: int


def puck_loop(seed: int) -> LoopInstance:
    """The scene of :func:`puck_komo`, with many contacts instead of one."""
    scene = puck_komo(seed).scene
    rng = np.random.default_rng([seed, *b"contacts"])
    robot = scene.robots["panda"]
    return LoopInstance(scene, tuple(top_contact(robot, scene.bodies[DISC], rng) for _ in range(CONTACTS)), seed)


def puck_komo(seed: int) -> MotionInstance:
    """The disc is carried by one given contact."""
    return sampled(_sample_instance, "puck_komo", seed)


def top_contact(robot, body: Body, rng: np.random.Generator) -> np.ndarray:
    """T_obj_ee (7,) of a fingertip on the top of a disc."""
    radius, height = body.shapes[0].size
    angle, distance = rng.uniform(-np.pi, np.pi), AROUND * radius * np.sqrt(rng.random())
    point = np.array([distance * np.cos(angle), distance * np.sin(angle), height / 2.0])
    tilt, way = rng.uniform(0.0, TILT), rng.uniform(-np.pi, np.pi)
    z = np.array([np.sin(tilt) * np.cos(way), np.sin(tilt) * np.sin(way), -np.cos(tilt)])
    return contact_pose(robot, point, np.array([0.0, 0.0, 1.0]), hand_axes(z, rng.uniform(-np.pi, np.pi)))


def _sample_instance(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda()
    radius, height = rng.uniform(*RADIUS), rng.uniform(*HEIGHT)
    side = rng.choice((-1.0, 1.0))
    start, goal = (pose((rng.uniform(*AHEAD), s * rng.uniform(*ASIDE), height / 2.0)) for s in (side, -side))
    disc = Body(DISC, BodyKind.MOVABLE, (Shape(ShapeKind.CYLINDER, (radius, height)),), start)
    size = rng.uniform(*OBSTACLE_SIZE)
    middle = (start[:2] + goal[:2]) / 2.0 + rng.uniform(-OFF, OFF, 2)
    obstacle = box(OBSTACLE, size, pose((*middle, size[2] / 2.0), yaw_quaternion(rng.uniform(-np.pi, np.pi))))
    scene = scene_of("puck_komo", seed, [table(), disc, obstacle], [robot], Goal(DISC, goal))
    attachment = Attachment(robot.name, DISC, 1, top_contact(robot, disc, rng), support=TABLE)
    if not ends_are_free(scene, 0.0, attachment, goal, rng, SAFE):
        return None
    return transfer_motion(scene, 0.0, STEPS, attachment, goal, (APPROACH, APPROACH_STEPS), seed, touching=True)
