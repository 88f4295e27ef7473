"""Position of a point of one frame seen from another."""

import numpy as np
from numba import carray, cfunc

from hmap_core.komo.features.base import CALLBACK, KERNEL, Feature
from hmap_core.komo.features.relative import relative_point


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 6), carray(r_, 3), carray(J_, (3, n))
    relative_point(R, p, first, prismatic, frames[0], frames[1], params[0], params[1], params[2], r, J)
    for i in range(3):
        r[i] -= params[3 + i]


def relative_position(frame: int, offset=(0.0, 0.0, 0.0), target=(0.0, 0.0, 0.0), reference: int = 0) -> Feature:
    """T_reference_world (p_frame + R_frame offset) - target, (3,), metres in the reference frame."""
    return Feature(
        "relative_position", _kernel.address, 3, (frame, reference), np.concatenate([offset, target]).astype(float)
    )
