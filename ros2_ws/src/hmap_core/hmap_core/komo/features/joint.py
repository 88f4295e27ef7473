"""Joint positions."""

import numpy as np
from numba import carray, cfunc

from hmap_core.komo.features.base import KERNEL, Feature


@cfunc(KERNEL, cache=True)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    q, target, r, J = carray(q_, n), carray(params_, n), carray(r_, n), carray(J_, (n, n))
    for i in range(n):
        r[i] = q[i] - target[i]
        J[i, i] += 1.0


def joint_position(target: np.ndarray) -> Feature:
    """q - target, (n,), rad or m."""
    target = np.asarray(target, float)
    return Feature("joint_position", _kernel.address, len(target), (), target, "rad")
