"""Rigid transforms over many samples at once: rotation matrices (N, 3, 3) and positions (N, 3).

The judge has its own, so that an error in the planner's transforms cannot hide in both.
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
    """The matrix (3, 3) whose product with a vector is the cross product of ``axis`` (3,) with it."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def about_axis(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) about a unit axis (3,) by angles (N,) in radians (Rodrigues' formula)."""
    K = cross_matrix(axis)
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def apply(R: np.ndarray, constant: np.ndarray) -> np.ndarray:
    """The rotations R (N, 3, 3) times one vector (3,) or one matrix (3, 3): (N, 3) or (N, 3, 3)."""
    # as one product of all rows: numpy's own loop over N small products takes ten times as long
    return (R.reshape(-1, 3) @ constant).reshape(len(R), 3, *constant.shape[1:])


def turned(R: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """The rotations R (N, 3, 3) followed by turns about an axis (3,) of their own frame by angles (N,)."""
    K = cross_matrix(axis)
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return R + s * apply(R, K) + (1.0 - c) * apply(R, K @ K)


def from_rpy(rpy: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of fixed-axis roll, pitch, yaw in radians (the URDF convention)."""
    roll, pitch, yaw = (np.array([angle], float) for angle in rpy)
    Rz, Ry, Rx = about_axis((0, 0, 1), yaw), about_axis((0, 1, 0), pitch), about_axis((1, 0, 0), roll)
    return (Rz @ Ry @ Rx)[0]


def turn(quaternions_a: np.ndarray, quaternions_b: np.ndarray) -> np.ndarray:
    """Angles (...,) in [0, pi] between unit quaternions (..., 4)."""
    # from the chord and not from the arc cosine of the dot product, which loses half its digits near zero
    near = np.linalg.norm(quaternions_a - quaternions_b, axis=-1)
    far = np.linalg.norm(quaternions_a + quaternions_b, axis=-1)
    return 4.0 * np.arctan2(np.minimum(near, far), np.maximum(near, far))


def turn_of(R: np.ndarray) -> np.ndarray:
    """Angles (...,) in [0, pi] of rotation matrices (..., 3, 3)."""
    axis = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    return np.arctan2(np.linalg.norm(axis, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1.0)


def turn_along(R: np.ndarray) -> np.ndarray:
    """Angles (N-1,) in [0, pi] between each two adjacent ones of rotation matrices (N, 3, 3)."""
    # the chord between two rotations by the angle t has the Frobenius norm 2 sqrt(2) sin(t / 2)
    chord = np.diff(R.reshape(-1, 9), axis=0)
    half = np.sqrt(np.einsum("ij,ij->i", chord, chord)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(half, 1.0))


def slerp(q_a: np.ndarray, q_b: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4) on the shortest arcs from ``q_a`` (s = 0) to ``q_b`` (s = 1), s (N,)."""
    q_b = np.where(np.sum(q_a * q_b, axis=-1, keepdims=True) < 0.0, -q_b, q_b)
    half = turn(q_a, q_b)[:, None] / 2.0
    s = s[:, None]
    small = half < 1e-9  # rad; the arc is straight there and sin(half) would divide by nothing
    divisor = np.where(small, 1.0, np.sin(half))
    wa = np.where(small, 1.0 - s, np.sin((1.0 - s) * half) / divisor)
    wb = np.where(small, s, np.sin(s * half) / divisor)
    q = wa * q_a + wb * q_b
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def between(poses_a: np.ndarray, poses_b: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Poses (N, 7): straight in position, shortest arc in rotation, at s (N,) of the way."""
    positions = poses_a[:, :3] + s[:, None] * (poses_b[:, :3] - poses_a[:, :3])
    return np.concatenate([positions, slerp(poses_a[:, 3:], poses_b[:, 3:], s)], axis=1)


def relative(Ra: np.ndarray, pa: np.ndarray, Rb: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frame b seen from frame a: rotations (N, 3, 3) and positions (N, 3)."""
    Rt = np.swapaxes(Ra, -1, -2)
    return Rt @ Rb, (Rt @ (pb - pa)[..., None])[..., 0]


def deviation(R: np.ndarray, p: np.ndarray, R0: np.ndarray, p0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N,) in metres and angles (N,) in radians between frames (R, p) and the frame (R0, p0)."""
    return np.linalg.norm(p - p0, axis=-1), turn_of(np.swapaxes(R0, -1, -2) @ R)
