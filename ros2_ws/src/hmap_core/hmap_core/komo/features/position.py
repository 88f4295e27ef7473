"""Position of a point of one frame seen from another."""

import numpy as np
from numba import carray, cfunc

from hmap_core.kinematics.tree import point_jacobian
from hmap_core.komo.features.base import KERNEL, Feature


@cfunc(KERNEL, cache=True)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 6), carray(r_, 3), carray(J_, (3, n))
    a, b = frames[0], frames[1]
    x0 = p[a, 0] + R[a, 0, 0] * params[0] + R[a, 0, 1] * params[1] + R[a, 0, 2] * params[2]
    x1 = p[a, 1] + R[a, 1, 0] * params[0] + R[a, 1, 1] * params[1] + R[a, 1, 2] * params[2]
    x2 = p[a, 2] + R[a, 2, 0] * params[0] + R[a, 2, 1] * params[1] + R[a, 2, 2] * params[2]
    for i in range(3):
        d0, d1, d2 = R[b, 0, i], R[b, 1, i], R[b, 2, i]
        r[i] = d0 * (x0 - p[b, 0]) + d1 * (x1 - p[b, 1]) + d2 * (x2 - p[b, 2]) - params[3 + i]
        # the point moves with a; seen from b, it moves against what b would carry along
        point_jacobian(R, p, first, prismatic, a, x0, x1, x2, d0, d1, d2, 1.0, J[i])
        point_jacobian(R, p, first, prismatic, b, x0, x1, x2, d0, d1, d2, -1.0, J[i])


def relative_position(frame: int, offset=(0.0, 0.0, 0.0), target=(0.0, 0.0, 0.0), reference: int = 0) -> Feature:
    """T_reference_world (p_frame + R_frame offset) - target, (3,), metres in the reference frame."""
    return Feature(
        "relative_position", _kernel.address, 3, (frame, reference), np.concatenate([offset, target]).astype(float)
    )
