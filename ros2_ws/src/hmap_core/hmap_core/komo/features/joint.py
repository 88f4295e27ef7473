"""Joint positions."""

import numpy as np
from numba import carray, cfunc

from hmap_core.exceptions import InputError
from hmap_core.komo.features.base import CALLBACK, KERNEL, MAX_DIM, Feature

_HEADER = 2  # numbers before the targets: first joint, number of joints


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    q, header = carray(q_, n), carray(params_, _HEADER)
    first, count = int(header[0]), int(header[1])
    params, r, J = carray(params_, _HEADER + count), carray(r_, count), carray(J_, (count, n))
    for i in range(count):
        if first + i >= n:
            r[i] = np.nan
            continue
        r[i] = q[first + i] - params[_HEADER + i]
        J[i, first + i] += 1.0


def joint_position(target: np.ndarray, first: int = 0) -> Feature:
    """q[first : first + m] - target, (m,), rad or m.

    Joints that the chain does not have are no number, which no solution satisfies.

    Args:
        target: (m,) rad, or m for sliding joints.
        first: the first of the joints; for those of one robot or free body, its ``KinematicModel.joints``.

    Raises:
        InputError: more joints than a feature has components.
    """
    target = np.atleast_1d(np.asarray(target, float))
    if not 1 <= len(target) <= MAX_DIM:
        raise InputError(f"joint_position of {len(target)} joints; allowed: 1 to {MAX_DIM}, more by a second feature")
    return Feature("joint_position", _kernel.address, len(target), (), np.r_[first, len(target), target], "rad")
