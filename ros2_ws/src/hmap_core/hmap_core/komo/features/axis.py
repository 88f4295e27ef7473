"""Alignment of an axis of a frame with a direction in another."""

import numpy as np
from numba import carray, cfunc

from hmap_core.komo.features.base import KERNEL, Feature


@cfunc(KERNEL, cache=True)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R = carray(R_, (n + 1, 3, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 6), carray(r_, 3), carray(J_, (3, n))
    a, b = frames[0], frames[1]
    v0 = R[a, 0, 0] * params[0] + R[a, 0, 1] * params[1] + R[a, 0, 2] * params[2]
    v1 = R[a, 1, 0] * params[0] + R[a, 1, 1] * params[1] + R[a, 1, 2] * params[2]
    v2 = R[a, 2, 0] * params[0] + R[a, 2, 1] * params[1] + R[a, 2, 2] * params[2]
    for i in range(3):
        d0, d1, d2 = R[b, 0, i], R[b, 1, i], R[b, 2, i]
        r[i] = d0 * v0 + d1 * v1 + d2 * v2 - params[3 + i]
        for side in range(2):
            frame = a if side == 0 else b
            sign = 1.0 if side == 0 else -1.0
            for k in range(first[frame], frame):
                if prismatic[k] == 0:
                    z0, z1, z2 = R[k + 1, 0, 2], R[k + 1, 1, 2], R[k + 1, 2, 2]
                    J[i, k] += sign * (d0 * (z1 * v2 - z2 * v1) + d1 * (z2 * v0 - z0 * v2) + d2 * (z0 * v1 - z1 * v0))


def axis_alignment(frame: int, axis, direction, reference: int = 0) -> Feature:
    """R_reference^T R_frame axis - direction, (3,), for unit vectors; 0 when aligned, 2 in length when opposed."""
    params = np.concatenate([axis, direction]).astype(float)
    return Feature("axis_alignment", _kernel.address, 3, (frame, reference), params, "1")
