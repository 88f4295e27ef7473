"""Alignment of an axis of a frame with a direction in another."""

import numpy as np
from numba import carray, cfunc

from hmap_core.komo.features.base import CALLBACK, KERNEL, Feature
from hmap_core.komo.features.relative import relative_axis


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R = carray(R_, (n + 1, 3, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 6), carray(r_, 3), carray(J_, (3, n))
    relative_axis(R, first, prismatic, frames[0], frames[1], params[0], params[1], params[2], r, J, 0)
    for i in range(3):
        r[i] -= params[3 + i]


def axis_alignment(frame: int, axis, direction, reference: int = 0) -> Feature:
    """R_reference^T R_frame axis - direction, (3,), for unit vectors; 0 when aligned, 2 in length when opposed."""
    params = np.concatenate([axis, direction]).astype(float)
    return Feature("axis_alignment", _kernel.address, 3, (frame, reference), params, "1")
