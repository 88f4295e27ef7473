"""Free bodies as chains of joints, and models of several arms and bodies."""

import numpy as np
import pytest
from core_fixtures import KINDS, arm, frames, random_hull, random_pose, random_q
from komo_fixtures import frame_pose, world_of

from hmap_core.collision.convex import from_hulls
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics import FreeBody, Freedom, KinematicModel, PlacedArm, extent_of
from hmap_core.kinematics.free_body import MAX_PITCH
from hmap_core.transforms import apply, distance, from_rpy, multiply, pose

MIXES = [("planar",), ("spatial",), ("panda", "spatial"), ("iiwa", "planar", "panda"), ("panda", "iiwa", "panda")]


def body_of(freedom, rng) -> FreeBody:
    size = np.ones(2 if freedom == Freedom.PLANAR else 3)
    return FreeBody("box", freedom, random_pose(rng, 1.0), -size, size, 0.3, random_pose(rng, 0.2))


@pytest.mark.parametrize("names", MIXES, ids="+".join)
def test_parts_stand_beside_each_other(names):
    """Every part is where it says, and moves nothing else."""
    rng = np.random.default_rng(1)
    world = world_of(*names)
    assert world.n == sum({"planar": 3, "spatial": 6}.get(name, 7) for name in names) == len(world.chain.lower)
    for _ in range(5):
        q = random_q(world.chain, rng)
        for name in world.offset:
            own = q[world.joints(name)]
            T = multiply(frame_pose(world.chain, q, world.tip(name)), world.T_tip_ee(name))
            if name in world.bodies:
                expected = world.bodies[name].pose(own)
            else:
                placed = world.arms[name]
                expected = multiply(placed.T_world_base, placed.arm.end_effector(own))
            assert max(distance(T, expected)) < 1e-9
            assert world.frame(name, 0) == 0 and world.frame(name, len(own)) == world.tip(name)
            other = random_q(world.chain, rng)
            other[world.joints(name)] = own
            assert (
                max(
                    distance(
                        frame_pose(world.chain, other, world.tip(name)), frame_pose(world.chain, q, world.tip(name))
                    )
                )
                < 1e-9
            )


@pytest.mark.parametrize("freedom", Freedom)
def test_coordinates_are_those_of_the_pose(freedom):
    rng = np.random.default_rng(2)
    for _ in range(20):
        body = body_of(freedom, rng)
        chain = KinematicModel([body]).chain
        q = random_q(chain, rng)
        found = body.coordinates(body.pose(q))
        turns = slice(-1 if freedom == Freedom.PLANAR else 3, None)
        np.testing.assert_allclose(np.exp(1j * found[turns]), np.exp(1j * q[turns]), atol=1e-9)
        np.testing.assert_allclose(found[: turns.start], q[: turns.start], atol=1e-9)
        assert (np.abs(found[turns]) <= np.pi).all()


def test_at_zero_it_is_at_its_reference_and_slides_along_it():
    rng = np.random.default_rng(3)
    T, rest = random_pose(rng, 1.0), random_pose(rng, 0.2)
    flat = FreeBody("flat", Freedom.PLANAR, T, -np.ones(2), np.ones(2), 0.1, rest)
    space = FreeBody("space", Freedom.SPATIAL, T, -np.ones(3), np.ones(3), 0.1, rest)
    for body in (flat, space):
        assert max(distance(body.pose(np.zeros(body.n)), multiply(T, rest))) < 1e-12
    turned = multiply(T, multiply(from_rpy((0.2, -0.3, 0.0), (0.0, 0.0, 0.7)), rest))
    assert max(distance(flat.pose(np.array([0.2, -0.3, 0.7])), turned)) < 1e-9
    lifted = multiply(T, multiply(pose((0.1, 0.2, 0.3)), rest))
    np.testing.assert_allclose(space.coordinates(lifted), [0.1, 0.2, 0.3, 0, 0, 0], atol=1e-9)


def test_no_turn_is_near_its_singularity():
    """Within the limits every rotation velocity is a combination of the turns, none of them fast."""
    rng = np.random.default_rng(4)
    world = world_of("spatial")
    assert world.chain.upper[4] == -world.chain.lower[4] == MAX_PITCH < np.pi / 2
    worst = 0.0
    for _ in range(50):
        R, _ = frames(world.chain, random_q(world.chain, rng))
        axes = np.array([R[f][:, 2] for f in (4, 5, 6)])
        worst = max(worst, np.linalg.norm(np.linalg.inv(axes), 2))
    assert worst <= 1.0 / np.sqrt(1.0 - np.sin(MAX_PITCH)) + 1e-9


@pytest.mark.parametrize("freedom", Freedom)
def test_no_point_moves_more_than_reach_says(freedom):
    rng = np.random.default_rng(5)
    share = 0.0
    for _ in range(50):
        shapes = from_hulls([random_hull(rng, kind) for kind in KINDS])
        rest = random_pose(rng, 0.1)
        size = np.ones(2 if freedom == Freedom.PLANAR else 3)
        body = FreeBody("box", freedom, random_pose(rng, 1.0), -size, size, extent_of(shapes, rest), rest)
        chain = KinematicModel([body]).chain
        q, dq = random_q(chain, rng), rng.normal(size=body.n) * 10.0 ** rng.integers(-3, 0)
        moved = apply(body.pose(q + dq), shapes.vertices) - apply(body.pose(q), shapes.vertices)
        moved, bound = np.linalg.norm(moved, axis=1).max(), chain.reach @ np.abs(dq)
        assert moved <= bound + 1e-12
        share = max(share, moved / bound)
    assert share > 0.3  # and the bound is no empty one


def test_limits_of_arms_and_of_bodies_are_kept_as_given():
    world = world_of("panda", "planar")
    lower, upper = arm("panda").model.position_limits
    np.testing.assert_array_equal(world.chain.lower[:7], lower)
    np.testing.assert_array_equal(world.chain.upper[:7], upper)
    body = world.bodies["planar_1"]
    np.testing.assert_array_equal(world.chain.lower[7:9], body.lower)
    np.testing.assert_array_equal(world.chain.upper[7:9], body.upper)


def test_what_makes_no_sense_is_refused():
    flat = FreeBody("flat", Freedom.PLANAR, pose(), -np.ones(2), np.ones(2), 0.1)
    with pytest.raises(InputError, match="'flat' is 0.01 off its plane"):
        flat.coordinates(pose((0.3, 0.0, 0.01)))
    with pytest.raises(InputError, match="'flat' is .* off its plane"):
        flat.coordinates(from_rpy((0.3, 0.0, 0.0), (0.1, 0.0, 0.0)))
    for lower, upper in ((np.zeros(3), np.ones(3)), (np.ones(2), np.zeros(2)), ([0.0, np.nan], [1.0, 1.0])):
        with pytest.raises(InputError, match="2 numbers each") as error:
            FreeBody("flat", Freedom.PLANAR, pose(), lower, upper, 0.1)
        assert error.value.code == Code.INVALID_SCENE
    with pytest.raises(InputError, match="extent is -1"):
        FreeBody("flat", Freedom.PLANAR, pose(), -np.ones(2), np.ones(2), -1.0)
    with pytest.raises(InputError, match="each name once"):
        KinematicModel([flat, PlacedArm("flat", arm("panda"), pose())])
    with pytest.raises(InputError, match="one or more"):
        KinematicModel([])
