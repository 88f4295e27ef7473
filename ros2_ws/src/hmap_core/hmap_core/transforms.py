"""Rigid transforms as pose vectors.

A pose is a float array (7,): position x, y, z in metres, then a unit quaternion x, y, z, w (xyzw, as in ROS,
PyBullet and SciPy). ``T_a_b`` is the pose of frame b expressed in frame a, so ``multiply(T_a_b, T_b_c)`` is ``T_a_c``.
Diebel, "Representing attitude", 2006, derives the quaternion formulas; it writes the scalar first.
"""

import math
import warnings
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
IDENTITY.setflags(write=False)

_Angle = TypeVar("_Angle", float, np.ndarray)


def pose(position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    """Builds a pose; the quaternion is normalised.

    Args:
        position: (3,) in metres.
        quaternion: (4,) xyzw, not zero.

    Returns:
        The pose (7,).
    """
    q = np.asarray(quaternion, float)
    return np.concatenate([np.asarray(position, float), q / np.linalg.norm(q)])


def from_rpy(position: ArrayLike, rpy: ArrayLike) -> np.ndarray:
    """Builds a pose from fixed-axis roll, pitch, yaw (the URDF convention).

    Args:
        position: (3,) in metres.
        rpy: (3,) in radians.

    Returns:
        The pose (7,).
    """
    return np.concatenate([np.asarray(position, float), Rotation.from_euler("xyz", rpy).as_quat()])


def euler_angles(T: np.ndarray, axes: str = "xyz") -> np.ndarray:
    """Angles (3,) in radians of the rotation of a pose (7,); ``axes`` as of SciPy, "xyz": roll, pitch, yaw.

    Where two of the angles turn about one axis, the third is zero.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock detected")
        return Rotation.from_quat(T[3:]).as_euler(axes)


def from_matrix(matrix: np.ndarray) -> np.ndarray:
    """Pose (7,) of a homogeneous matrix (4, 4)."""
    return np.concatenate([matrix[:3, 3], quaternions(matrix[None, :3, :3])[0]])


def to_matrix(T: np.ndarray) -> np.ndarray:
    """Homogeneous matrix (4, 4) of a pose (7,)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(T)
    matrix[:3, 3] = T[:3]
    return matrix


def _numbers(array: np.ndarray) -> list[float]:
    """Converts an array to Python floats, whose arithmetic is several times faster than that of NumPy scalars."""
    return np.asarray(array, float).tolist()


def _rotated(q: Sequence | np.ndarray, v: Sequence | np.ndarray) -> tuple:
    """Rotates the vector v by the unit quaternion q (xyzw). The components are numbers or arrays."""
    x, y, z, w = q
    a, b, c = v
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


def rotation_matrix(T: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a pose (7,)."""
    return np.array(rotation_numbers(T)).reshape(3, 3)


def rotation_matrices(T: np.ndarray) -> np.ndarray:
    """Rotation matrices (M, 3, 3) of poses (M, 7)."""
    x, y, z, w = np.asarray(T, float)[:, 3:].T
    R = np.empty((len(T), 3, 3))
    R[:, 0, 0], R[:, 0, 1], R[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[:, 1, 0], R[:, 1, 1], R[:, 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[:, 2, 0], R[:, 2, 1], R[:, 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return R


def quaternions(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (M, 4) xyzw of rotation matrices (M, 3, 3).

    The entries of 4 q q^T are linear in the matrix (Shepperd, "Quaternion from rotation matrix", 1978). Every row of
    that product is a multiple of q; the row with the largest diagonal entry is normalised, which is the best
    conditioned one.
    """
    products = np.empty((len(R), 4, 4))
    diagonal = R[:, [0, 1, 2], [0, 1, 2]]
    trace = diagonal.sum(axis=1)
    products[:, [0, 1, 2], [0, 1, 2]] = 1.0 + 2.0 * diagonal - trace[:, None]
    products[:, 3, 3] = 1.0 + trace
    turned = R.transpose(0, 2, 1)
    products[:, [0, 0, 1], [1, 2, 2]] = products[:, [1, 2, 2], [0, 0, 1]] = (R + turned)[:, [0, 0, 1], [1, 2, 2]]
    products[:, :3, 3] = products[:, 3, :3] = (R - turned)[:, [2, 0, 1], [1, 2, 0]]
    own = np.arange(len(R)), products[:, [0, 1, 2, 3], [0, 1, 2, 3]].argmax(axis=1)
    q = products[own]
    return q / np.sqrt(np.einsum("ij,ij->i", q, q))[:, None]


def rotation_numbers(T: np.ndarray) -> tuple[float, ...]:
    """The nine entries of the rotation matrix of a pose (7,), row by row."""
    x, y, z, w = _numbers(T)[3:]
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


def quaternion_multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product (4,) of two quaternions (4,) xyzw."""
    return np.array(_product(_numbers(a), _numbers(b)))


def _product(a: Sequence | np.ndarray, b: Sequence | np.ndarray) -> tuple:
    """Hamilton product of two quaternions xyzw. The components are numbers or arrays."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def multiply(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """Composes two poses.

    Args:
        T_a_b: (7,).
        T_b_c: (7,).

    Returns:
        ``T_a_c`` (7,), with a normalised quaternion.
    """
    a, b = _numbers(T_a_b), _numbers(T_b_c)
    x, y, z, w = _product(a[3:], b[3:])
    length = math.sqrt(x * x + y * y + z * z + w * w)
    u, v, t = _rotated(a[3:], b[:3])
    return np.array([a[0] + u, a[1] + v, a[2] + t, x / length, y / length, z / length, w / length])


def multiply_all(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """Composes M pairs of poses at once.

    Args:
        T_a_b: (M, 7), or one pose (7,) for all.
        T_b_c: (M, 7), or one pose (7,) for all.

    Returns:
        ``T_a_c`` (M, 7), with normalised quaternions.
    """
    A, B = np.atleast_2d(T_a_b).T, np.atleast_2d(T_b_c).T
    q = np.array(np.broadcast_arrays(*_product(A[3:], B[3:])))
    p = np.array(np.broadcast_arrays(*_rotated(A[3:], B[:3]))) + A[:3]
    return np.ascontiguousarray(np.concatenate([p, q / np.sqrt(np.einsum("ij,ij->j", q, q))]).T)


def inverse(T_a_b: np.ndarray) -> np.ndarray:
    """Inverse ``T_b_a`` (7,) of a pose ``T_a_b`` (7,)."""
    a = _numbers(T_a_b)
    back = -a[3], -a[4], -a[5], a[6]
    x, y, z = _rotated(back, a[:3])
    return np.array([-x, -y, -z, *back])


def apply(T_a_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transforms points from frame b to frame a.

    Args:
        T_a_b: (7,).
        points: (..., 3) in metres, frame b.

    Returns:
        The points (..., 3) in frame a.
    """
    return np.asarray(points) @ rotation_matrix(T_a_b).T + T_a_b[:3]


def distance(T_a: np.ndarray, T_b: np.ndarray) -> tuple[float, float]:
    """Distance between two poses (7,).

    Returns:
        The distance of the positions in metres and the rotation angle in radians, in [0, pi].
    """
    # atan2 of the relative quaternion is exact near zero; arccos of the dot product loses half its digits there
    q = quaternion_multiply(T_a[3:] * [-1.0, -1.0, -1.0, 1.0], T_b[3:])
    angle = 2.0 * np.arctan2(np.linalg.norm(q[:3]), abs(q[3]))
    return float(np.linalg.norm(T_a[:3] - T_b[:3])), float(angle)


def wrapped(angle: _Angle) -> _Angle:
    """The angle in rad, or each of several, in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def consistent(poses: np.ndarray) -> np.ndarray:
    """Flips quaternion signs so that adjacent quaternions are in the same hemisphere; the poses stay the same.

    Args:
        poses: (M, 7).

    Returns:
        (M, 7).
    """
    turns = np.einsum("ij,ij->i", poses[1:, 3:], poses[:-1, 3:]) < 0.0
    sign = np.where(np.cumsum([False, *turns]) % 2, -1.0, 1.0)
    return np.concatenate([poses[:, :3], poses[:, 3:] * sign[:, None]], axis=1)


def interpolate(T_a: np.ndarray, T_b: np.ndarray, s: ArrayLike) -> np.ndarray:
    """Interpolates between two poses: linear in position, spherical linear (Shoemake 1985) in rotation.

    Args:
        T_a: (7,) pose at s = 0.
        T_b: (7,) pose at s = 1.
        s: (...) fractions in [0, 1].

    Returns:
        The poses (..., 7).
    """
    s = np.asarray(s, float)
    rotations = Slerp([0.0, 1.0], Rotation.from_quat([T_a[3:], T_b[3:]]))(s.reshape(-1)).as_quat()
    positions = T_a[:3] + s.reshape(-1, 1) * (T_b[:3] - T_a[:3])
    return np.concatenate([positions, rotations], axis=1).reshape(s.shape + (7,))
