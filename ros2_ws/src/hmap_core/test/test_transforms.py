"""Poses against scipy's rotations and plain matrices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hmap_core.transforms import (
    IDENTITY,
    apply,
    consistent,
    euler_angles,
    from_matrix,
    inverse,
    multiply,
    multiply_all,
    pose,
    quaternion_multiply,
    quaternions,
    rotation_matrices,
    rotation_matrix,
    to_matrix,
)


def random_pose(rng) -> np.ndarray:
    return pose(rng.uniform(-1, 1, 3), rng.normal(size=4))


@pytest.mark.parametrize("seed", range(5))
def test_poses_multiply_as_matrices_do(seed):
    rng = np.random.default_rng(seed)
    a, b = random_pose(rng), random_pose(rng)
    np.testing.assert_allclose(to_matrix(multiply(a, b)), to_matrix(a) @ to_matrix(b), atol=1e-12)
    np.testing.assert_allclose(to_matrix(inverse(a)), np.linalg.inv(to_matrix(a)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(multiply(a, b)[3:]), 1.0, atol=1e-15)
    np.testing.assert_allclose(rotation_matrix(a), Rotation.from_quat(a[3:]).as_matrix(), atol=1e-12)
    product = (Rotation.from_quat(a[3:]) * Rotation.from_quat(b[3:])).as_matrix()
    np.testing.assert_allclose(rotation_matrix([0, 0, 0, *quaternion_multiply(a[3:], b[3:])]), product, atol=1e-12)
    points = rng.normal(size=(4, 3))
    np.testing.assert_allclose(apply(a, points), points @ to_matrix(a)[:3, :3].T + a[:3], atol=1e-12)


def test_many_poses_multiply_as_each_does():
    rng = np.random.default_rng(9)
    a, b = [random_pose(rng) for _ in range(6)], random_pose(rng)
    for found, T in zip(multiply_all(np.array(a), b), a, strict=True):
        np.testing.assert_allclose(to_matrix(found), to_matrix(multiply(T, b)), atol=1e-12)
    np.testing.assert_allclose(multiply(a[0], IDENTITY), a[0], atol=1e-15)
    np.testing.assert_allclose(to_matrix(from_matrix(to_matrix(a[0]))), to_matrix(a[0]), atol=1e-12)


def test_many_rotations_there_and_back():
    """Also where the angle is half a turn, about any axis, and where there is no turn at all."""
    axes = np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(4).normal(size=(20, 3))])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    vectors = np.concatenate([angle * axes for angle in (0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi, 4.0)])
    poses = np.concatenate([np.zeros_like(vectors), Rotation.from_rotvec(vectors).as_quat()], axis=1)
    R = rotation_matrices(poses)
    np.testing.assert_allclose(R, Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-15)
    found = quaternions(R)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", found, poses[:, 3:])), 1.0, atol=1e-14)
    assert rotation_matrices(poses[:0]).shape == (0, 3, 3) and quaternions(R[:0]).shape == (0, 4)


def test_quaternions_of_a_path_do_not_turn_round():
    turns = Rotation.from_rotvec(np.linspace(0, 12, 50)[:, None] * [0.0, 0.0, 1.0]).as_quat()
    signs = np.random.default_rng(3).choice([-1.0, 1.0], 50)
    poses = np.concatenate([np.ones((50, 3)), turns * signs[:, None]], axis=1)
    found = consistent(poses)
    assert (np.einsum("ij,ij->i", found[1:, 3:], found[:-1, 3:]) > 0.9).all()
    np.testing.assert_array_equal(found[0], poses[0])
    np.testing.assert_allclose(Rotation.from_quat(found[:, 3:]).as_matrix(), Rotation.from_quat(turns).as_matrix())


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("axes", ["xyz", "XYZ"])
def test_euler_angles_are_found_without_a_warning_where_they_are_not_unique(pitch, axes, recwarn):
    T = pose((1, 2, 3), Rotation.from_euler(axes, (0.4, pitch, -0.7)).as_quat())
    angles = euler_angles(T, axes)
    np.testing.assert_allclose(Rotation.from_euler(axes, angles).as_matrix(), to_matrix(T)[:3, :3], atol=1e-7)
    assert not recwarn.list
