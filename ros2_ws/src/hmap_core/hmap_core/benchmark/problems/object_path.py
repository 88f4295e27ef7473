"""The path of a box without a robot: out of a U-shaped trap, into a tunnel, through a window. All obstacles are
boxes.
"""

import numpy as np

from hmap_core.benchmark.instances import box
from hmap_core.benchmark.problems.common import yaw_quaternion
from hmap_core.transforms import from_rpy, pose
from hmap_core.types import BodyKind
from hmap_core.waypoints import ObjectPathProblem

OBJECT = "object"
HEIGHT = 0.1  # m; height of the body in planar motion, and of its walls
THICKNESS = 0.04  # m of walls
# the trap
BRICK = (0.2, 0.1, HEIGHT)
TRAP_WIDTH, TRAP_DEPTH = (0.36, 0.46), (0.35, 0.5)  # m, inside
TRAP_BOUNDS = ((-1.0, -0.8), (0.8, 0.8))
# the tunnel
BAR = (0.3, 0.06, HEIGHT)
TUNNEL_CLEARANCE = 0.005  # m on each side
TUNNEL_LENGTH = (0.3, 0.5)  # m
TUNNEL_BOUNDS = ((-1.0, -0.8), (1.0, 0.8))
# the window
STICK = (0.05, 0.4, 0.05)
WINDOW_SIZE = (0.12, 0.16)  # m, square
WALL = (1.0, 1.0)  # m; half its width, and its height
WINDOW_BOUNDS = ((-0.6, -0.8, 0.2), (0.6, 0.8, 0.8))


def se2(seed: int) -> ObjectPathProblem:
    """Out of a trap (even seeds) or into a tunnel (odd seeds)."""
    rng = np.random.default_rng([seed, *b"rrt_se2"])
    return _tunnel(rng) if seed % 2 else _trap(rng)


def se3(seed: int) -> ObjectPathProblem:
    """Through a window that is smaller than the stick's length; at start and goal the stick is parallel to the wall."""
    rng = np.random.default_rng([seed, *b"rrt_se3"])
    size, y, z = rng.uniform(*WINDOW_SIZE), rng.uniform(-0.2, 0.2), rng.uniform(0.4, 0.6)
    half, top = WALL
    low, high, left, right = z - size / 2, z + size / 2, y - size / 2, y + size / 2
    walls = (
        box("below", (THICKNESS, 2 * half, low), pose((0, 0, low / 2))),
        box("over", (THICKNESS, 2 * half, top - high), pose((0, 0, (top + high) / 2))),
        box("left", (THICKNESS, left + half, size), pose((0, (left - half) / 2, z))),
        box("right", (THICKNESS, half - right, size), pose((0, (right + half) / 2, z))),
    )
    start, goal = (
        from_rpy((side, rng.uniform(-0.3, 0.3), rng.uniform(0.35, 0.65)), (rng.uniform(-np.pi, np.pi), 0.0, 0.0))
        for side in (-0.3, 0.3)
    )
    stick = box(OBJECT, STICK, start, BodyKind.MOVABLE)
    bounds = np.array(WINDOW_BOUNDS)
    return ObjectPathProblem(stick, start, goal, walls, "spatial", 0.0, bounds)


def _planar(size, start, goal, walls, bounds) -> ObjectPathProblem:
    body = box(OBJECT, size, start, BodyKind.MOVABLE)
    bounds = np.column_stack([bounds, np.full(2, HEIGHT / 2)])
    return ObjectPathProblem(body, start, goal, walls, "planar", 0.0, bounds)


def _lying(x: float, y: float, yaw: float) -> np.ndarray:
    return pose((x, y, HEIGHT / 2), yaw_quaternion(yaw))


def _any_yaw(rng: np.random.Generator) -> float:
    return rng.uniform(-np.pi, np.pi)


def _trap(rng: np.random.Generator) -> ObjectPathProblem:
    width, depth = rng.uniform(*TRAP_WIDTH), rng.uniform(*TRAP_DEPTH)
    side = (width + THICKNESS) / 2
    walls = (
        box("bottom", (THICKNESS, width + 2 * THICKNESS, HEIGHT), _lying(0, 0, 0)),
        box("left", (depth, THICKNESS, HEIGHT), _lying(-(depth + THICKNESS) / 2, side, 0)),
        box("right", (depth, THICKNESS, HEIGHT), _lying(-(depth + THICKNESS) / 2, -side, 0)),
    )
    start = _lying(-0.22, rng.uniform(-0.04, 0.04), _any_yaw(rng))
    goal = _lying(rng.uniform(0.2, 0.4), rng.uniform(-0.3, 0.3), _any_yaw(rng))
    return _planar(BRICK, start, goal, walls, TRAP_BOUNDS)


def _tunnel(rng: np.random.Generator) -> ObjectPathProblem:
    length, y = rng.uniform(*TUNNEL_LENGTH), rng.uniform(-0.2, 0.2)
    edge, half = TUNNEL_BOUNDS[1][1], BAR[1] / 2 + TUNNEL_CLEARANCE
    upper, lower = edge - (y + half), (y - half) + edge
    walls = (
        box("upper", (length, upper, HEIGHT), _lying(0, y + half + upper / 2, 0)),
        box("lower", (length, lower, HEIGHT), _lying(0, y - half - lower / 2, 0)),
    )
    start = _lying(-length / 2 - 0.35, rng.uniform(-0.4, 0.4), _any_yaw(rng))
    goal = _lying(rng.uniform(-0.05, 0.05), y, 0.0)
    return _planar(BAR, start, goal, walls, TUNNEL_BOUNDS)
