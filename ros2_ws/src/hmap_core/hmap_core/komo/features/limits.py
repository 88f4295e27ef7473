"""Bounds on joints: their positions, and by the order of the objective their rates."""

import numpy as np
from numba import carray, cfunc

from hmap_core.exceptions import InputError
from hmap_core.komo.features.base import CALLBACK, KERNEL, MAX_DIM, Feature

_HEADER = 2  # numbers before the bounds: first joint, number of joints


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    q, header = carray(q_, n), carray(params_, _HEADER)
    first, count = int(header[0]), int(header[1])
    bounds = carray(params_, _HEADER + 2 * count)[_HEADER:]
    r, J = carray(r_, 2 * count), carray(J_, (2 * count, n))
    for i in range(count):
        if first + i >= n:
            r[i] = r[count + i] = np.nan
            continue
        r[i] = q[first + i] - bounds[count + i]
        r[count + i] = bounds[i] - q[first + i]
        J[i, first + i] += 1.0
        J[count + i, first + i] -= 1.0


def joint_limits(lower: np.ndarray, upper: np.ndarray, first: int = 0) -> Feature:
    """(q - upper, lower - q), (2 m,), of the joints first .. first + m - 1; not above zero where they are kept.

    The solver keeps the limits of the chain anyway; this is for tighter ones, in some steps or of some joints.

    Args:
        lower, upper: (m,) rad, or m for sliding joints.
        first: the first of the joints.

    Raises:
        InputError: bounds of unequal length or order, or more joints than a feature has components for.
    """
    lower, upper = (np.atleast_1d(np.asarray(bound, float)) for bound in (lower, upper))
    m = len(lower)
    if lower.shape != upper.shape or not 1 <= m <= MAX_DIM // 2:
        raise InputError(
            f"joint_limits with {lower.size} lower and {upper.size} upper bounds; allowed: as many of each, "
            f"1 to {MAX_DIM // 2}, more by a second feature"
        )
    if not (lower <= upper).all():
        k = int(np.argmin(lower <= upper))
        raise InputError(f"joint_limits: the lower bound {lower[k]:g} of joint {first + k} is not below {upper[k]:g}")
    return Feature("joint_limits", _kernel.address, 2 * m, (), np.r_[first, m, lower, upper], "rad")


def joint_rate_limits(lower: np.ndarray, upper: np.ndarray, first: int = 0) -> tuple[Feature, np.ndarray]:
    """(feature, target) of an inequality of order 1 that bounds velocities, or of order 2, accelerations.

    What a difference leaves of (q - upper, lower - q) is (dq, -dq), so the bounds go into the objective's target.

    Args:
        lower, upper: (m,) rad/s or rad/s^2 (m for sliding joints), for steps that last ``tau`` seconds.
        first: the first of the joints.

    Raises:
        InputError: as :func:`joint_limits`.
    """
    feature = joint_limits(lower, upper, first)
    bounds = feature.params[_HEADER:]
    m = len(bounds) // 2
    return feature, np.r_[bounds[m:], -bounds[:m]]
