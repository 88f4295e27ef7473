"""Rigid transforms of many samples at once: rotation matrices (N, 3, 3) and positions (N, 3).

The judge has its own implementation, so that an error in the planner's transforms cannot hide in both.
"""

import numpy as np


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4) xyzw."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def cross_matrix(axis: np.ndarray) -> np.ndarray:
    """Skew-symmetric matrix (3, 3) of a vector (3,): its product with v is the cross product axis x v."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def about_axis(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) about a unit axis (3,) by angles (N,) in radians (Rodrigues' formula)."""
    K = cross_matrix(axis)
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def apply(R: np.ndarray, constant: np.ndarray) -> np.ndarray:
    """Products of rotations R (N, 3, 3) with one vector (3,) or one matrix (3, 3): (N, 3) or (N, 3, 3)."""
    # one product of all rows: NumPy's loop over N small products takes ten times as long
    return (R.reshape(-1, 3) @ constant).reshape(len(R), 3, *constant.shape[1:])


def rotated(R: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rotations R (N, 3, 3) followed by rotations about an axis (3,) of their own frame by angles (N,) in radians."""
    K = cross_matrix(axis)
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return R + s * apply(R, K) + (1.0 - c) * apply(R, K @ K)


def from_rpy(rpy: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of fixed-axis roll, pitch, yaw in radians (the URDF convention)."""
    roll, pitch, yaw = (np.array([angle], float) for angle in rpy)
    x, y, z = np.eye(3)
    Rz, Ry, Rx = about_axis(z, yaw), about_axis(y, pitch), about_axis(x, roll)
    return (Rz @ Ry @ Rx)[0]


def angle_between(quaternions_a: np.ndarray, quaternions_b: np.ndarray) -> np.ndarray:
    """Angles (...,) in [0, pi] between unit quaternions (..., 4)."""
    # from the chord: arccos of the dot product loses half its digits near zero
    near = np.linalg.norm(quaternions_a - quaternions_b, axis=-1)
    far = np.linalg.norm(quaternions_a + quaternions_b, axis=-1)
    return 4.0 * np.arctan2(np.minimum(near, far), np.maximum(near, far))


def rotation_angle(R: np.ndarray) -> np.ndarray:
    """Angles (...,) in [0, pi] of rotation matrices (..., 3, 3)."""
    axis = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    return np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1.0)


def step_angles(R: np.ndarray) -> np.ndarray:
    """Angles (N-1,) in [0, pi] between adjacent rotation matrices of (N, 3, 3)."""
    # the difference of two rotations at an angle t has the Frobenius norm 2 sqrt(2) sin(t / 2)
    chord = np.diff(R.reshape(-1, 9), axis=0)
    half = np.sqrt(np.einsum("ij,ij->i", chord, chord)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(half, 1.0))


def slerp(q_a: np.ndarray, q_b: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Spherical linear interpolation (Shoemake 1985) on the shortest arcs.

    Args:
        q_a: (N, 4) unit quaternions at s = 0.
        q_b: (N, 4) unit quaternions at s = 1.
        s: (N,) in [0, 1].

    Returns:
        (N, 4).
    """
    q_b = np.where(np.sum(q_a * q_b, axis=-1, keepdims=True) < 0.0, -q_b, q_b)
    half = angle_between(q_a, q_b)[:, None] / 2.0
    s = s[:, None]
    small = half < 1e-9  # rad; the arc is straight there, and sin(half) is nearly zero
    divisor = np.where(small, 1.0, np.sin(half))
    wa = np.where(small, 1.0 - s, np.sin((1.0 - s) * half) / divisor)
    wb = np.where(small, s, np.sin(s * half) / divisor)
    q = wa * q_a + wb * q_b
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def interpolate(poses_a: np.ndarray, poses_b: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Interpolates poses: linear in position, shortest arc in rotation.

    Args:
        poses_a: (N, 7) at s = 0.
        poses_b: (N, 7) at s = 1.
        s: (N,) in [0, 1].

    Returns:
        (N, 7).
    """
    positions = poses_a[:, :3] + s[:, None] * (poses_b[:, :3] - poses_a[:, :3])
    return np.concatenate([positions, slerp(poses_a[:, 3:], poses_b[:, 3:], s)], axis=1)


def relative(Ra: np.ndarray, pa: np.ndarray, Rb: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose of frame b in frame a.

    Args:
        Ra, pa: (N, 3, 3) and (N, 3), frame a in the world.
        Rb, pb: (N, 3, 3) and (N, 3), frame b in the world.

    Returns:
        Rotations (N, 3, 3) and positions (N, 3).
    """
    Rt = np.swapaxes(Ra, -1, -2)
    return Rt @ Rb, (Rt @ (pb - pa)[..., None])[..., 0]


def deviation(R: np.ndarray, p: np.ndarray, R0: np.ndarray, p0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N,) in metres and angles (N,) in radians between frames (R, p) and the frame (R0, p0)."""
    return np.linalg.norm(p - p0, axis=-1), rotation_angle(np.swapaxes(R0, -1, -2) @ R)
