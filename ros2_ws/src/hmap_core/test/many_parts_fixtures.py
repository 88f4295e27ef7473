"""Bodies and scenes of many convex parts."""

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
