"""Compiled forward kinematics and point Jacobians of serial chains with joints about or along their local z axis."""

import math

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, OPTIONS


@nb.njit(**INLINE)
def forward(q, parent, R_joint, p_joint, prismatic, R, p):
    """Forward kinematics of several serial chains.

    Args:
        q: (n,) joint positions, rad or m.
        parent: (n,) index of the parent frame of each joint; frame 0 is the world, frame i + 1 follows joint i.
        R_joint, p_joint: (n, 3, 3), (n, 3) fixed transform from the parent frame to the joint frame at value zero.
        prismatic: (n,) 1 for prismatic joints.
        R, p: output, (n + 1, 3, 3) and (n + 1, 3), world frames.
    """
    for i in range(3):
        p[0, i] = 0.0
        for j in range(3):
            R[0, i, j] = 1.0 if i == j else 0.0
    for k in range(q.shape[0]):
        a = parent[k]
        f = k + 1
        x0, x1, x2 = p_joint[k, 0], p_joint[k, 1], p_joint[k, 2]
        if prismatic[k] == 1:
            x0 += q[k] * R_joint[k, 0, 2]
            x1 += q[k] * R_joint[k, 1, 2]
            x2 += q[k] * R_joint[k, 2, 2]
            c, s = 1.0, 0.0
        else:
            c, s = math.cos(q[k]), math.sin(q[k])
        for i in range(3):
            r0, r1, r2 = R[a, i, 0], R[a, i, 1], R[a, i, 2]
            p[f, i] = p[a, i] + r0 * x0 + r1 * x1 + r2 * x2
            m0 = r0 * R_joint[k, 0, 0] + r1 * R_joint[k, 1, 0] + r2 * R_joint[k, 2, 0]
            m1 = r0 * R_joint[k, 0, 1] + r1 * R_joint[k, 1, 1] + r2 * R_joint[k, 2, 1]
            R[f, i, 0] = c * m0 + s * m1
            R[f, i, 1] = -s * m0 + c * m1
            R[f, i, 2] = r0 * R_joint[k, 0, 2] + r1 * R_joint[k, 1, 2] + r2 * R_joint[k, 2, 2]


@nb.njit(**OPTIONS)
def forward_last(Q, parent, R_joint, p_joint, prismatic):
    """Forward kinematics of the last frame at M configurations.

    Args:
        Q: (M, n) joint positions, rad or m.
        parent, R_joint, p_joint, prismatic: see :func:`forward`.

    Returns:
        Rotations (M, 3, 3) and origins (M, 3).
    """
    M, n = Q.shape
    R, p = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    R_last, p_last = np.empty((M, 3, 3)), np.empty((M, 3))
    for m in range(M):
        forward(Q[m], parent, R_joint, p_joint, prismatic, R, p)
        R_last[m] = R[n]
        p_last[m] = p[n]
    return R_last, p_last


@nb.njit(**INLINE)
def point_jacobian(R, p, first, prismatic, frame, x0, x1, x2, d0, d1, d2, sign, row):
    """Adds ``sign`` times the gradient of d . x to a row (n,) of a Jacobian; x is a world point fixed in ``frame``."""
    for k in range(first[frame], frame):
        f = k + 1
        z0, z1, z2 = R[f, 0, 2], R[f, 1, 2], R[f, 2, 2]
        if prismatic[k] == 1:
            row[k] += sign * (d0 * z0 + d1 * z1 + d2 * z2)
        else:
            r0, r1, r2 = x0 - p[f, 0], x1 - p[f, 1], x2 - p[f, 2]
            row[k] += sign * (d0 * (z1 * r2 - z2 * r1) + d1 * (z2 * r0 - z0 * r2) + d2 * (z0 * r1 - z1 * r0))
