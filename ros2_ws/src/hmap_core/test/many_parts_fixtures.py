"""Bodies and scenes of many convex parts, and how long a search among them takes."""

import time
from collections.abc import Callable

from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind


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


def ends_within(seconds: float, search: Callable[[], None]) -> bool:
    """Whether a search ends within some seconds, the best of three times.

    The processor time of the thread counts, as other work on the machine and in the process does not matter. What the
    first search loads is no part of the second.
    """
    for _ in range(3):
        began = time.thread_time()
        search()
        if time.thread_time() - began < seconds:
            return True
    return False
