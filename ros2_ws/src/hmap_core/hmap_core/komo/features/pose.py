"""Pose of a frame with a fixed offset, seen from another frame, against a target pose."""

import math

import numba as nb
import numpy as np
from numba import carray, cfunc

from hmap_core.collision.compile_options import INLINE
from hmap_core.komo.features.base import CALLBACK, KERNEL, Feature
from hmap_core.komo.features.relative import relative_point
from hmap_core.transforms import rotation_matrices, rotation_numbers


@nb.njit(**INLINE)
def _quaternion(m00, m01, m02, m10, m11, m12, m20, m21, m22):
    """Unit quaternion xyzw, w >= 0, of a rotation matrix; the branch with the largest pivot."""
    trace = m00 + m11 + m22
    if trace > 0.0:
        s = math.sqrt(trace + 1.0) * 2.0
        x, y, z, w = (m21 - m12) / s, (m02 - m20) / s, (m10 - m01) / s, 0.25 * s
    elif m00 > m11 and m00 > m22:
        s = math.sqrt(1.0 + m00 - m11 - m22) * 2.0
        x, y, z, w = 0.25 * s, (m01 + m10) / s, (m02 + m20) / s, (m21 - m12) / s
    elif m11 > m22:
        s = math.sqrt(1.0 + m11 - m00 - m22) * 2.0
        x, y, z, w = (m01 + m10) / s, 0.25 * s, (m12 + m21) / s, (m02 - m20) / s
    else:
        s = math.sqrt(1.0 + m22 - m00 - m11) * 2.0
        x, y, z, w = (m02 + m20) / s, (m12 + m21) / s, 0.25 * s, (m10 - m01) / s
    sign = 1.0 if w >= 0.0 else -1.0
    return sign * x, sign * y, sign * z, sign * w


@nb.njit(**INLINE)
def _world_to_target(params, R, b, i):
    """Row i of target^T R_b^T: from world to the target's axes."""
    t0, t1, t2 = params[15 + i], params[18 + i], params[21 + i]
    return (
        t0 * R[b, 0, 0] + t1 * R[b, 0, 1] + t2 * R[b, 0, 2],
        t0 * R[b, 1, 0] + t1 * R[b, 1, 1] + t2 * R[b, 1, 2],
        t0 * R[b, 2, 0] + t1 * R[b, 2, 1] + t2 * R[b, 2, 2],
    )


@nb.njit(**INLINE)
def _offset_axis(params, R, a, j):
    """Column j of R_a offset: an axis of the offset frame in the world."""
    t0, t1, t2 = params[3 + j], params[6 + j], params[9 + j]
    return (
        R[a, 0, 0] * t0 + R[a, 0, 1] * t1 + R[a, 0, 2] * t2,
        R[a, 1, 0] * t0 + R[a, 1, 1] * t1 + R[a, 1, 2] * t2,
        R[a, 2, 0] * t0 + R[a, 2, 1] * t1 + R[a, 2, 2] * t2,
    )


@nb.njit(**INLINE)
def _dot(u, v0, v1, v2):
    return u[0] * v0 + u[1] * v1 + u[2] * v2


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 24), carray(r_, 6), carray(J_, (6, n))
    a, b = frames[0], frames[1]
    relative_point(R, p, first, prismatic, a, b, params[0], params[1], params[2], r, J)
    for i in range(3):
        r[i] -= params[12 + i]
    # E = target^T R_b^T R_a offset; its quaternion's vector part, doubled, is the rotation error in the target frame
    d0, d1, d2 = _world_to_target(params, R, b, 0), _world_to_target(params, R, b, 1), _world_to_target(params, R, b, 2)
    x0, x1, x2 = _offset_axis(params, R, a, 0)
    y0, y1, y2 = _offset_axis(params, R, a, 1)
    z0, z1, z2 = _offset_axis(params, R, a, 2)
    x, y, z, w = _quaternion(
        _dot(d0, x0, x1, x2), _dot(d0, y0, y1, y2), _dot(d0, z0, z1, z2),
        _dot(d1, x0, x1, x2), _dot(d1, y0, y1, y2), _dot(d1, z0, z1, z2),
        _dot(d2, x0, x1, x2), _dot(d2, y0, y1, y2), _dot(d2, z0, z1, z2),
    )  # fmt: skip
    r[3], r[4], r[5] = 2.0 * x, 2.0 * y, 2.0 * z
    for side in range(2):
        frame = a if side == 0 else b
        sign = 1.0 if side == 0 else -1.0
        for k in range(first[frame], frame):
            if prismatic[k] == 1:
                continue
            z0, z1, z2 = sign * R[k + 1, 0, 2], sign * R[k + 1, 1, 2], sign * R[k + 1, 2, 2]
            o0, o1, o2 = _dot(d0, z0, z1, z2), _dot(d1, z0, z1, z2), _dot(d2, z0, z1, z2)
            # quaternion rate of a rotation velocity o given on the left: (w o + o x v) / 2
            J[3, k] += w * o0 + o1 * z - o2 * y
            J[4, k] += w * o1 + o2 * x - o0 * z
            J[5, k] += w * o2 + o0 * y - o1 * x


def pose_params(T_frame_offset: np.ndarray, T_reference_target: np.ndarray) -> np.ndarray:
    """Parameters (24,) of the kernel from two poses (7,): the offset in the frame and the target in the reference."""
    return np.array(
        (
            *T_frame_offset[:3].tolist(),
            *rotation_numbers(T_frame_offset),
            *T_reference_target[:3].tolist(),
            *rotation_numbers(T_reference_target),
        )
    )


def pose_params_all(T_frame_offset: np.ndarray, T_reference_target: np.ndarray) -> np.ndarray:
    """:func:`pose_params` (M, 24) of one offset (7,) and many targets (M, 7)."""
    M = len(T_reference_target)
    targets = rotation_matrices(T_reference_target).reshape(M, 9)
    offset = np.array((*T_frame_offset[:3].tolist(), *rotation_numbers(T_frame_offset)))
    return np.concatenate([np.tile(offset, (M, 1)), T_reference_target[:, :3], targets], axis=1)


def relative_pose(frame: int, T_frame_offset, T_reference_target, reference: int = 0) -> Feature:
    """Pose error (6,): position in metres in the reference frame, then twice the vector part of the error quaternion.

    The second half is the rotation vector for small errors (rad), 2 sin(angle / 2) in length. It is smooth up to half a
    turn, where it jumps and where its slope along the error is cos(angle / 2) = 0. Used with order 1 it therefore says
    "the relative pose stays" only for relative poses well within half a turn of the target; where the relative pose is
    free, as in a grasp that is chosen, use :func:`~hmap_core.komo.features.stable.stable`.
    """
    params = pose_params(np.asarray(T_frame_offset, float), np.asarray(T_reference_target, float))
    return Feature("relative_pose", _kernel.address, 6, (frame, reference), params, "m, rad", 3)
