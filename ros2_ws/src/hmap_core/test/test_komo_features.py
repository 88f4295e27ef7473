"""Every feature: its value, and its Jacobian against finite differences, with one arm and with two."""

import ctypes

import numpy as np
import pytest
from core_fixtures import frames, model, random_pose, random_q

from hmap_core.komo.features import axis_alignment, joint_position, relative_pose, relative_position
from hmap_core.transforms import distance, from_matrix, inverse, multiply, pose

STEP = 1e-6  # rad, m


def evaluate(feature, chain, q):
    """Value (dim,) and Jacobian (dim, n), as the solver calls the kernel."""
    n = len(q)
    R, p = (np.ascontiguousarray(x) for x in frames(chain, q))
    r, J = np.zeros(feature.dim), np.zeros((feature.dim, n))
    arrays = (R, p, chain.first, chain.prismatic, np.array(q, float), np.array([*feature.frames, 0], np.int64),
              np.array([*feature.params, 0.0]), r, J)  # fmt: skip
    kernel = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 9)(feature.kernel)
    kernel(n, *(a.ctypes.data for a in arrays))
    return r, J


def differences(feature, chain, q):
    columns = []
    for step in STEP * np.eye(len(q)):
        columns.append((evaluate(feature, chain, q + step)[0] - evaluate(feature, chain, q - step)[0]) / (2 * STEP))
    return np.array(columns).T


def configurations(chain, rng):
    """Random ones, and near-singular ones: stretched, at the limits, and half-way round."""
    n = len(chain.lower)
    yield from (random_q(chain, rng) for _ in range(8))
    yield np.zeros(n)
    yield 1e-7 * rng.normal(size=n)
    yield chain.lower.copy()
    yield np.where(np.arange(n) % 2, chain.upper, 0.0)


def cases(world, rng):
    """Features of every kind, between frames of one arm, of two, and the world."""
    names = list(world.arms)
    tip, other = world.tip(names[0]), world.tip(names[-1])
    links = [(tip, 0), (tip - 2, 2), (0, tip), (tip, tip)]
    if other != tip:
        links += [(tip, other), (other, 3), (other - 1, 0)]
    unit = lambda v: v / np.linalg.norm(v)  # noqa: E731
    for frame, reference in links:
        yield relative_position(frame, rng.normal(size=3), rng.normal(size=3), reference)
        yield relative_pose(frame, random_pose(rng, 0.3), random_pose(rng, 0.8), reference)
        yield axis_alignment(frame, unit(rng.normal(size=3)), unit(rng.normal(size=3)), reference)
    yield joint_position(rng.normal(size=world.n))


@pytest.mark.parametrize("names", [("panda",), ("iiwa", "panda")], ids="+".join)
def test_jacobians_are_the_derivatives(names):
    rng = np.random.default_rng(1)
    world = model(*names)
    for q in configurations(world.chain, rng):
        for feature in cases(world, rng):
            r, J = evaluate(feature, world.chain, q)
            if feature.name == "relative_pose" and np.linalg.norm(r[3:]) > 1.999:
                continue  # half a turn away the error jumps
            np.testing.assert_allclose(J, differences(feature, world.chain, q), atol=5e-7, err_msg=feature.name)


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
