"""Every feature: its value, and its Jacobian against central differences, of arms and of free bodies."""

import numpy as np
import pytest
from core_fixtures import KINDS, frames, model, random_hull, random_pose, random_q
from komo_fixtures import WORLDS, assert_derivative, configurations, evaluate, frame_pose, world_of

from hmap_core.collision.convex import ConvexSet, convex_set, from_hulls, set_distance, transformed
from hmap_core.collision.gjk import signed_distance
from hmap_core.exceptions import InputError
from hmap_core.komo.features import (
    above,
    axis_alignment,
    clearance,
    friction_cone,
    joint_limits,
    joint_position,
    joint_rate_limits,
    relative_pose,
    relative_position,
    stable,
)
from hmap_core.komo.features import (
    distance as signed,
)
from hmap_core.komo.features.base import MAX_DIM
from hmap_core.transforms import distance, from_matrix, inverse, multiply, pose, rotation_matrix
from hmap_core.types import Shape, ShapeKind

HOME = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.6, 0.5])  # of a Panda


def unit(rng) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_set(rng, kinds=KINDS) -> ConvexSet:
    """Pieces of all kinds round the origin of a frame."""
    pieces = from_hulls([random_hull(rng, kind) for kind in kinds])
    return transformed(pieces, random_pose(rng, 0.1))


# Every feature between a frame and a reference, with random numbers.
BETWEEN = {
    "relative_position": lambda rng, a, b: relative_position(a, rng.normal(size=3), rng.normal(size=3), b),
    "relative_pose": lambda rng, a, b: relative_pose(a, random_pose(rng, 0.3), random_pose(rng, 0.8), b),
    "stable": lambda rng, a, b: stable(a, b, rng.normal(size=3)),
    "axis_alignment": lambda rng, a, b: axis_alignment(a, unit(rng), unit(rng), b),
    "friction_cone": lambda rng, a, b: friction_cone(a, unit(rng), unit(rng), rng.uniform(0.2, 1.0), b),
    "above: standing": lambda rng, a, b: above(a, random_pose(rng, 0.2), 0.05, random_pose(rng, 0.5), (0.2, 0.1), b)[0],
    "above: within": lambda rng, a, b: above(a, random_pose(rng, 0.2), 0.05, random_pose(rng, 0.5), (0.2, 0.1), b)[1],
    "distance": lambda rng, a, b: signed(a, random_set(rng), b, random_set(rng)),
    "clearance": lambda rng, a, b: clearance(a, random_set(rng), b, random_set(rng), 0.1),
}


def links(world) -> list[tuple[int, int]]:
    """Frames of one part, of two, and of the world."""
    tips = [world.tip(name) for name in world.offset]
    first, last = tips[0], tips[-1]
    found = [(first, 0), (first - 2, 2), (0, last), (last - 1, 1), (first, first)]
    return found if first == last else [*found, (first, last), (last, 3)]


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
@pytest.mark.parametrize("kind", BETWEEN)
def test_jacobians_are_the_derivatives(kind, names):
    rng = np.random.default_rng(1)
    world = world_of(*names)
    for q in configurations(world.chain, rng):
        for frame, reference in links(world):
            feature = BETWEEN[kind](rng, frame, reference)
            assert feature.name == kind
            if kind == "relative_pose" and np.linalg.norm(evaluate(feature, world.chain, q)[0][3:]) > 1.9999:
                continue  # half a turn away the error jumps
            if kind in ("distance", "clearance") and frame == reference:
                continue  # nothing moves
            assert_derivative(feature, world.chain, q)


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
def test_jacobians_of_joint_features(names):
    rng = np.random.default_rng(2)
    world = world_of(*names)
    q, n = random_q(world.chain, rng), min(world.n, MAX_DIM)
    for feature in (
        joint_position(rng.normal(size=n)),
        joint_position(rng.normal(size=n - 2), 2),
        joint_limits(-np.ones(n // 2), np.ones(n // 2), 1),
    ):
        assert_derivative(feature, world.chain, q)


# --- where others would have no derivative


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-3])
def test_relative_pose_near_no_error_and_near_half_a_turn(names, angle):
    rng = np.random.default_rng(3)
    world = world_of(*names)
    frame, reference = links(world)[-1]
    for q in configurations(world.chain, rng):
        actual = multiply(inverse(frame_pose(world.chain, q, reference)), frame_pose(world.chain, q, frame))
        error = pose(np.zeros(3), np.r_[np.sin(angle / 2) * unit(rng), np.cos(angle / 2)])
        assert_derivative(relative_pose(frame, pose(), multiply(actual, error), reference), world.chain, q)


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["aligned", "opposed"])
def test_axes_that_are_aligned_or_opposed(names, side):
    rng = np.random.default_rng(4)
    world = world_of(*names)
    frame, reference = links(world)[-1]
    for q in configurations(world.chain, rng):
        R, _ = frames(world.chain, q)
        axis = unit(rng)
        direction = side * R[reference].T @ R[frame] @ axis
        aligned, cone = (
            axis_alignment(frame, axis, direction, reference),
            friction_cone(frame, axis, direction, 0.5, reference),
        )
        assert np.linalg.norm(evaluate(aligned, world.chain, q)[0]) == pytest.approx(1.0 - side, abs=1e-12)
        r, J = evaluate(cone, world.chain, q)
        assert r[0] == pytest.approx((1.0 - side * np.sqrt(1.25)) / 0.5)
        np.testing.assert_allclose(J, 0.0, atol=1e-12)
        for feature in (aligned, cone):
            assert_derivative(feature, world.chain, q)


def shifted(world, q, pieces, gap):
    """(feature, distance) of two sets on the tip and on another frame, the second moved so that the gap is ``gap``."""
    (frame, reference), (a, b) = links(world)[-1], pieces
    T = [frame_pose(world.chain, q, f) for f in (frame, reference)]
    A, B = transformed(a, T[0]), transformed(b, T[1])
    B = transformed(B, pose(A.center[0] - B.center[0] + [0.9, 0.5, 0.7]))
    eye, witness = np.eye(3), np.zeros((3, 3))
    d = signed_distance(A.hull(0), eye, np.zeros(3), A.radius[0], B.hull(0), eye, np.zeros(3), B.radius[0], witness)
    B = transformed(B, pose((d - gap) * witness[0]))
    return signed(frame, a, reference, transformed(B, inverse(T[1])))


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
@pytest.mark.parametrize(
    "kinds", [("box", "box"), ("hull", "box"), ("sphere", "hull"), ("capsule", "sphere")], ids="-".join
)
def test_distance_from_far_to_just_touching(kinds, names):
    rng = np.random.default_rng(5)
    world = world_of(*names)
    round_ones = {"sphere", "capsule"} & set(kinds)
    for q in configurations(world.chain, rng):
        pieces = [from_hulls([random_hull(rng, kind)]) for kind in kinds]
        for gap in (0.3, 0.01, 0.0, -0.001) if round_ones else (0.3, 0.01):
            feature = shifted(world, q, pieces, gap)
            assert evaluate(feature, world.chain, q)[0][0] == pytest.approx(gap, abs=1e-8)
            assert_derivative(feature, world.chain, q, 1e-6)


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
def test_distance_in_deep_overlap(names):
    rng = np.random.default_rng(6)
    world = world_of(*names)
    frame, reference = links(world)[-1]
    for q in configurations(world.chain, rng):
        T = multiply(inverse(frame_pose(world.chain, q, reference)), frame_pose(world.chain, q, frame))
        for _ in range(3):
            a, b = (from_hulls([random_hull(rng, kind)]) for kind in rng.choice(["box", "hull"], 2))
            feature = signed(frame, a, reference, transformed(b, multiply(T, random_pose(rng, 0.01))))
            assert evaluate(feature, world.chain, q)[0][0] < -0.005
            assert_derivative(feature, world.chain, q, 1e-6)


# --- values


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
def test_distance_is_the_smallest_over_the_pieces(names):
    rng = np.random.default_rng(7)
    world = world_of(*names)
    for q in configurations(world.chain, rng):
        for frame, reference in links(world):
            a, b = random_set(rng), random_set(rng)
            T = [frame_pose(world.chain, q, f) for f in (frame, reference)]
            expected = set_distance(a, T[0], b, T[1])
            r, J = evaluate(signed(frame, a, reference, b), world.chain, q)
            assert r[0] == pytest.approx(expected, abs=2e-6)
            min_distance, slope = evaluate(clearance(frame, a, reference, b, 0.05), world.chain, q)
            assert min_distance[0] == pytest.approx(0.05 - r[0])
            np.testing.assert_allclose(slope, -J, atol=1e-12)


def test_friction_cone_is_zero_on_its_surface_and_counts_radians_there():
    world = world_of("spatial")
    for friction in (0.1, 0.5, 1.0):
        half = np.arctan(friction)
        for angle, sign in ((0.0, -1), (0.9 * half, -1), (half, 0), (1.1 * half, 1), (3.0, 1)):
            axis = np.array([0.0, 2.0 * np.sin(angle), 2.0 * np.cos(angle)])  # its length does not matter
            upward = rotation_matrix(frame_pose(world.chain, np.zeros(6), 6))[:, 2]
            feature = friction_cone(6, axis, upward, friction)
            r, J = evaluate(feature, world.chain, np.zeros(6))
            assert (np.sign(r[0]) if abs(r[0]) > 1e-12 else 0) == sign
            if sign == 0:
                assert np.linalg.norm(J) == pytest.approx(1.0)  # rad per rad


def test_stable_is_constant_while_one_carries_the_other_and_tells_what_slips():
    rng = np.random.default_rng(8)
    world = world_of("panda", "spatial")
    body, hand = world.bodies["spatial_1"], world.tip("panda_0")
    T_hand_tip = random_pose(rng, 0.1)
    values = []
    for turn in (0.0, 0.2, 0.4):
        q = np.r_[HOME + turn, np.zeros(6)]
        T_tip = multiply(frame_pose(world.chain, q, hand), T_hand_tip)
        q[7:] = body.coordinates(multiply(T_tip, body.T_tip_body))
        assert max(distance(frame_pose(world.chain, q, world.tip("spatial_1")), T_tip)) < 1e-9
        values.append(evaluate(stable(world.tip("spatial_1"), hand), world.chain, q)[0])
    np.testing.assert_allclose(values[1:], [values[0]] * 2, atol=1e-9)
    q[7] += 0.01
    slipped = evaluate(stable(world.tip("spatial_1"), hand), world.chain, q)[0] - values[0]
    assert np.linalg.norm(slipped[:3]) == pytest.approx(0.01) and np.abs(slipped[3:]).max() < 1e-9
    q[7] -= 0.01
    q[12] += 0.3
    turned = evaluate(stable(world.tip("spatial_1"), hand), world.chain, q)[0] - values[0]
    assert np.linalg.norm(turned[3:]) == pytest.approx(2 * np.sqrt(2) * np.sin(0.15))


def test_joint_features_look_at_their_joints_only():
    world = world_of("iiwa", "panda")
    q = np.arange(14.0)
    r, J = evaluate(joint_position([8.5, 10.0], world.joints("panda_1").start + 1), world.chain, q)
    np.testing.assert_array_equal(r, [-0.5, -1.0])
    np.testing.assert_array_equal(J, np.eye(14)[8:10])
    r, J = evaluate(joint_limits([0.0, 5.0], [1.5, 6.0], 2), world.chain, q)
    np.testing.assert_array_equal(r, [0.5, -3.0, -2.0, 2.0])
    np.testing.assert_array_equal(J, np.r_[np.eye(14)[2:4], -np.eye(14)[2:4]])


def test_joints_that_are_not_there_are_no_number():
    world = world_of("panda")
    for feature in (joint_position(np.zeros(3), 5), joint_limits(np.zeros(3), np.ones(3), 5)):
        r, J = evaluate(feature, world.chain, HOME)
        assert np.isnan(r[2]) and np.isfinite(r[:2]).all() and not J[2].any()


def test_rate_limits_are_a_target_of_differences():
    feature, target = joint_rate_limits([-1.0, -2.0], [1.5, 2.5], 3)
    world = world_of("panda")
    before, after = (evaluate(feature, world.chain, q)[0] for q in (HOME, HOME + 0.1))
    np.testing.assert_allclose(after - before - target, [0.1 - 1.5, 0.1 - 2.5, -0.1 - 1.0, -0.1 - 2.0])


@pytest.mark.parametrize(
    "make, says",
    [
        (lambda: joint_position(np.zeros(MAX_DIM + 1)), f"{MAX_DIM + 1} joints; allowed: 1 to {MAX_DIM}"),
        (lambda: joint_limits([0.0], [0.0, 1.0]), "1 lower and 2 upper bounds"),
        (lambda: joint_limits(np.zeros(MAX_DIM), np.ones(MAX_DIM)), f"1 to {MAX_DIM // 2}"),
        (lambda: joint_limits([0.0, 2.0], [1.0, 1.0], 3), "bound 2 of joint 4 is not below 1"),
        (lambda: joint_limits([np.nan], [1.0]), "bound nan of joint 0"),
        (lambda: friction_cone(1, (0, 0, 1), (0, 0, 1), 0.0), "friction is 0; allowed: above 0"),
        (lambda: friction_cone(1, (0, 0, 0), (0, 0, 1), 0.5), "axis is .*not all zero"),
        (lambda: friction_cone(1, (0, 0, 1), (1, 0), 0.5), "normal is .*three numbers"),
        (
            lambda: signed(1, from_hulls([]), 0, convex_set([Shape(ShapeKind.SPHERE, (0.1,))])),
            "first body has no pieces",
        ),
        (lambda: clearance(1, convex_set([Shape(ShapeKind.SPHERE, (0.1,))]), 0, from_hulls([])), "second body has no"),
    ],
)
def test_what_makes_no_sense_is_refused(make, says):
    with pytest.raises(InputError, match=says):
        make()


@pytest.mark.parametrize("names", [("panda",), ("iiwa", "panda")], ids="+".join)
def test_relative_pose_is_zero_at_its_target_and_measures_the_rest(names):
    rng = np.random.default_rng(2)
    world = model(*names)
    first, last = list(world.arms)[0], list(world.arms)[-1]
    frame, reference = world.tip(first), world.tip(last) if first != last else 2
    for _ in range(20):
        q = random_q(world.chain, rng)
        R, p = frames(world.chain, q)
        T = [from_matrix(np.block([[R[f], p[f][:, None]], [np.zeros((1, 3)), 1]])) for f in (frame, reference)]
        offset = random_pose(rng, 0.2)
        actual = multiply(inverse(T[1]), multiply(T[0], offset))
        r, _ = evaluate(relative_pose(frame, offset, actual, reference), world.chain, q)
        np.testing.assert_allclose(r, 0.0, atol=1e-9)
        error = random_pose(rng, 0.1)
        target = multiply(actual, inverse(error))  # so the frame is off by ``error`` in the target's frame
        r, _ = evaluate(relative_pose(frame, offset, target, reference), world.chain, q)
        apart = distance(actual, target)
        assert np.linalg.norm(r[:3]) == pytest.approx(apart[0], abs=1e-9)
        assert np.linalg.norm(r[3:]) == pytest.approx(2 * np.sin(apart[1] / 2), abs=1e-9)
        np.testing.assert_allclose(r[3:], 2 * np.sign(error[6]) * error[3:6], atol=1e-9)


def test_small_rotations_count_in_radians():
    world = model("panda")
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.6, 0.5])
    R, p = frames(world.chain, q)
    actual = from_matrix(np.block([[R[-1], p[-1][:, None]], [np.zeros((1, 3)), 1]]))
    turned = multiply(actual, pose(quaternion=(0, 0, np.sin(0.005), np.cos(0.005))))
    r, _ = evaluate(relative_pose(7, pose(), turned), world.chain, q)
    np.testing.assert_allclose(r, [0, 0, 0, 0, 0, -0.01], atol=1e-6)


def test_axis_alignment_is_zero_when_aligned_and_two_when_opposed():
    world = model("panda")
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.6, 0.5])
    R, _ = frames(world.chain, q)
    z = R[-1][:, 2]
    assert np.linalg.norm(evaluate(axis_alignment(7, (0, 0, 1), z), world.chain, q)[0]) == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(evaluate(axis_alignment(7, (0, 0, 1), -z), world.chain, q)[0]) == pytest.approx(2)
    local = R[4].T @ z
    r, _ = evaluate(axis_alignment(7, (0, 0, 1), local, reference=4), world.chain, q)
    np.testing.assert_allclose(r, 0.0, atol=1e-12)
