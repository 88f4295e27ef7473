"""A bar pushed by its end along a tunnel, with 5 mm of room on either side.

The tunnel and the bar have the cross sections of the published task (``hmap_scenes/tasks/published/tunnel.yaml``), and
the robot has the same pose relative to them. They are as short as one Panda needs for the push.
"""

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, TABLE, panda, sampled, table, transfer_motion, yaw_quaternion
from hmap_core.benchmark.sampling import contact_pose, hand_axes, straight_push_is_free
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Goal, Shape, ShapeKind

BAR, TUNNEL = "bar", "tunnel"
STEPS = (10, 10)
BASE_HEIGHT = 0.05  # m
ASIDE = (0.35, 0.45)  # m; distance of the tunnel in front of the robot
WIDTH, INNER_WIDTH = 0.08, 0.09  # m of the bar, which is as high as wide, and of the tunnel
INNER_HEIGHT, WALL, ROOF = 0.1, 0.03, 0.03  # m
BAR_LENGTH = (0.3, 0.45)  # m
TUNNEL_LENGTH = (0.2, 0.35)  # m
ENTRANCE = (-0.15, 0.05)  # m along the tunnel, relative to the robot
INSIDE = 0.05  # m of the bar inside the tunnel at the start
PUSH = (0.08, 0.16)  # m
PLAY = 0.002  # m; distance of the bar from the tunnel's middle at start and goal
TILT = (np.deg2rad(30.0), np.deg2rad(60.0))  # of the hand, from the bar's direction towards straight down
AROUND = 0.5  # share of the end face in which contacts lie
APPROACH_STEPS = 2
APPROACH = 0.04  # m


def tunnel_push(seed: int) -> MotionInstance:
    """The bar, the tunnel and the contact are drawn at random."""
    return sampled(_sample_instance, "tunnel_push", seed)


def _tunnel(length: float, middle: np.ndarray) -> Body:
    side = (INNER_WIDTH + WALL) / 2.0
    walls = [
        Shape(ShapeKind.BOX, (length, WALL, INNER_HEIGHT), pose((0.0, y, INNER_HEIGHT / 2.0))) for y in (-side, side)
    ]
    roof = Shape(ShapeKind.BOX, (length, INNER_WIDTH + 2.0 * WALL, ROOF), pose((0.0, 0.0, INNER_HEIGHT + ROOF / 2.0)))
    return Body(TUNNEL, BodyKind.FIXED, (roof, *walls), pose(middle))


def _sample_instance(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robot = panda(base=pose((0.0, 0.0, BASE_HEIGHT), yaw_quaternion(np.pi / 2.0)))
    y, entrance = rng.uniform(*ASIDE), rng.uniform(*ENTRANCE)
    bar, tunnel = rng.uniform(*BAR_LENGTH), rng.uniform(*TUNNEL_LENGTH)
    off = rng.uniform(-PLAY, PLAY, 2)
    start = pose((entrance + INSIDE - bar / 2.0, y + off[0], WIDTH / 2.0))
    goal = pose((start[0] + rng.uniform(*PUSH), y + off[1], WIDTH / 2.0))
    tilt, roll = rng.uniform(*TILT), rng.uniform(-np.pi, np.pi)
    point = np.array([-bar / 2.0, *(AROUND * rng.uniform(-WIDTH / 2.0, WIDTH / 2.0, 2))])
    axes = hand_axes(np.array([np.cos(tilt), 0.0, -np.sin(tilt)]), roll)
    contact = contact_pose(robot, point, np.array([-1.0, 0.0, 0.0]), axes)
    bodies = [
        table(),
        box(BAR, (bar, WIDTH, WIDTH), start, BodyKind.MOVABLE),
        _tunnel(tunnel, np.array([entrance + tunnel / 2.0, y, 0.0])),
    ]
    scene = scene_of("tunnel_push", seed, bodies, [robot], Goal(BAR, goal))
    attachment = Attachment(robot.name, BAR, 1, contact, support=TABLE)
    if not straight_push_is_free(scene, 0.0, attachment, goal, APPROACH, rng, SAFE):
        return None
    return transfer_motion(scene, 0.0, STEPS, attachment, goal, (APPROACH, APPROACH_STEPS), seed, touching=True)
