"""Shapes that only just touch, or nearly: where the algorithm for separated shapes hands over to that for overlap."""

import numpy as np
import pytest
from core_fixtures import random_hull, random_pose
from komo_fixtures import evaluate, frame_pose, world_of

from hmap_core.collision.convex import convex_set, from_hulls, transformed
from hmap_core.komo.features import distance
from hmap_core.transforms import inverse, multiply, pose, rotation_matrix
from hmap_core.types import Shape, ShapeKind

TOUCHING = 2e-9  # m: what a distance may be off where shapes touch


@pytest.mark.parametrize("gap", [-1e-5, -1e-8, -1e-13, 0.0, 1e-13, 1e-10, 1e-9, 1e-8, 1e-6, 1e-5])
def test_a_corner_that_just_touches_a_face(gap):
    """Value and slope are those of the face, on both sides of zero."""
    world = world_of("spatial")
    q = np.r_[0.1, 0.2, 0.3, 0.5, -0.4, 0.3]
    T_tip = frame_pose(world.chain, q, 6)
    R = rotation_matrix(next(iter(world.bodies.values())).T_world_reference)
    floor = convex_set([Shape(ShapeKind.BOX, (1.0, 1.0, 0.1), pose((0, 0, -0.05)))])
    for seed in range(100):
        rng = np.random.default_rng(seed)
        hull = transformed(from_hulls([random_hull(rng, rng.choice(["box", "hull"]))]), random_pose(rng, 0.0))
        corner = hull.vertices[hull.vertices[:, 2].argmin()]
        hull = transformed(hull, pose(np.r_[rng.uniform(-0.3, 0.3, 2), gap] - corner))
        T = random_pose(rng, 1.0)  # of the floor, so that nothing is along the axes
        feature = distance(6, transformed(hull, multiply(inverse(T_tip), T)), 0, transformed(floor, T))
        r, J = evaluate(feature, world.chain, q)
        assert r[0] == pytest.approx(gap, abs=TOUCHING)
        np.testing.assert_allclose(J[0, :3], R.T @ rotation_matrix(T)[:, 2], atol=1e-6)
