"""Bodies and scenes of many convex parts."""

import numpy as np

from hmap_core.transforms import from_rpy, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import ObjectPathProblem

WALL = 2.0  # m, side of the wall in which the window is


def random_pose(rng, spread):
    return pose(rng.uniform(-spread, spread, 3), rng.standard_normal(4))


def parts(name, count, rng, spread, size=(0.02, 0.1)):
    """A fixed body of boxes, balls and capsules, thrown into a cube."""
    shapes = []
    for k in range(count):
        a, b, c = rng.uniform(*size, 3)
        kinds = [(ShapeKind.BOX, (a, b, c)), (ShapeKind.SPHERE, (a / 2,)), (ShapeKind.CAPSULE, (a / 3, b))]
        shapes.append(Shape(*kinds[k % 3], random_pose(rng, spread)))
    return Body(name, BodyKind.FIXED, tuple(shapes), pose())


def bracket(count, rng, size=0.3):
    """A concave body: three bars at right angles, one after the other, of many small boxes."""
    shapes = []
    for bar, many in enumerate((count - 2 * (count // 3), count // 3, count // 3)):
        corner, along = np.array([[-0.5, -0.5, 0], [-0.5, -0.5, 0], [0.5, -0.5, 0]])[bar], np.eye(3)[bar]
        for k in range(many):
            at = size * (corner + along * (k + 0.5) / many) + rng.normal(0, 0.004, 3)
            shapes.append(Shape(ShapeKind.BOX, tuple(rng.uniform(0.01, 0.03, 3)), pose(at, rng.standard_normal(4))))
    return Body("bracket", BodyKind.MOVABLE, tuple(shapes), pose(), 1.0)


def window(count, seed, hole=0.4, lid=False):
    """A bracket of ``count`` parts passes a wall of about as many, between scattered boxes. A lid closes the hole."""
    rng = np.random.default_rng(seed)
    start, goal = np.array([-0.8, 0.3, 0.2]), np.array([0.8, -0.3, -0.1])
    rows = int(np.sqrt(0.7 * count * 1.1))
    cell = WALL / rows
    grid = (np.arange(rows) + 0.5) * cell - 0.5 * WALL
    wall = [
        Shape(ShapeKind.BOX, (0.06, *(cell * rng.uniform(1.0, 1.1, 2))), pose((rng.normal(0, 0.01), y, z)))
        for y in grid
        for z in grid
        if max(abs(y), abs(z)) > 0.5 * (hole + cell)
    ]
    scattered: list[Shape] = []
    while len(wall) + len(scattered) < count:
        at = rng.uniform([-1.2, -1, -1], [1.2, 1, 1])
        if all(np.linalg.norm(at - free) > 0.42 for free in (start, goal, 0 * at)):
            size = tuple(rng.uniform(0.02, 0.08, 3))
            scattered.append(Shape(ShapeKind.BOX, size, pose(at, rng.standard_normal(4))))
    around = [  # nothing passes beside the wall
        Shape(ShapeKind.BOX, (0.02, *size), pose((0, *at)))
        for s in (-1, 1)
        for size, at in (((90, 45), (0, s * (22.5 + 0.49 * WALL))), ((45, 90), (s * (22.5 + 0.49 * WALL), 0)))
    ]
    lids = [Shape(ShapeKind.BOX, (0.02, 1, 1), pose())] if lid else []
    bodies = [("wall", wall), ("boxes", scattered), ("around", around), ("lid", lids)]
    obstacles = tuple(Body(name, BodyKind.FIXED, tuple(shapes), pose()) for name, shapes in bodies if shapes)
    body = bracket(count, rng)
    return ObjectPathProblem(body, pose(start), from_rpy(goal, (1.0, 0.5, -0.7)), obstacles, "spatial")
