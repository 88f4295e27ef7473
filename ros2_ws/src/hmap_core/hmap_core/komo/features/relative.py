"""A point and an axis of one frame seen from another, compiled: what most features are made of."""

import numba as nb

from hmap_core.collision.compile_options import INLINE
from hmap_core.kinematics.tree import point_jacobian


@nb.njit(**INLINE)
def relative_point(R, p, first, prismatic, a, b, x, y, z, r, J):
    """Writes R_b^T (p_a + R_a (x, y, z) - p_b) to r[:3], m, and adds its derivative to J (.., n).

    Args:
        R, p: world rotations (n + 1, 3, 3) and origins (n + 1, 3) of the frames.
        first, prismatic: of the chain, see :mod:`hmap_core.kinematics.chain`.
        a, b: numbers of the frames.
        x, y, z: the point in frame a.
    """
    x0 = p[a, 0] + R[a, 0, 0] * x + R[a, 0, 1] * y + R[a, 0, 2] * z
    x1 = p[a, 1] + R[a, 1, 0] * x + R[a, 1, 1] * y + R[a, 1, 2] * z
    x2 = p[a, 2] + R[a, 2, 0] * x + R[a, 2, 1] * y + R[a, 2, 2] * z
    for i in range(3):
        d0, d1, d2 = R[b, 0, i], R[b, 1, i], R[b, 2, i]
        r[i] = d0 * (x0 - p[b, 0]) + d1 * (x1 - p[b, 1]) + d2 * (x2 - p[b, 2])
        # the point moves with a; seen from b, it moves against what b would carry along
        point_jacobian(R, p, first, prismatic, a, x0, x1, x2, d0, d1, d2, 1.0, J[i])
        point_jacobian(R, p, first, prismatic, b, x0, x1, x2, d0, d1, d2, -1.0, J[i])


@nb.njit(**INLINE)
def relative_axis(R, first, prismatic, a, b, x, y, z, r, J, row):
    """The same of R_b^T R_a (x, y, z), for an axis, in the rows from ``row`` of r and J."""
    v0 = R[a, 0, 0] * x + R[a, 0, 1] * y + R[a, 0, 2] * z
    v1 = R[a, 1, 0] * x + R[a, 1, 1] * y + R[a, 1, 2] * z
    v2 = R[a, 2, 0] * x + R[a, 2, 1] * y + R[a, 2, 2] * z
    for i in range(3):
        d0, d1, d2 = R[b, 0, i], R[b, 1, i], R[b, 2, i]
        r[row + i] = d0 * v0 + d1 * v1 + d2 * v2
        for side in range(2):
            frame = a if side == 0 else b
            sign = 1.0 if side == 0 else -1.0
            for k in range(first[frame], frame):
                if prismatic[k] == 0:
                    z0, z1, z2 = R[k + 1, 0, 2], R[k + 1, 1, 2], R[k + 1, 2, 2]
                    J[row + i, k] += sign * (
                        d0 * (z1 * v2 - z2 * v1) + d1 * (z2 * v0 - z0 * v2) + d2 * (z0 * v1 - z1 * v0)
                    )
