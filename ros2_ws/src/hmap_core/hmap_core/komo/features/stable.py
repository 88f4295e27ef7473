"""Relative pose without a target: what must not change while one thing carries another (KOMO's ``stable``)."""

import numpy as np
from numba import carray, cfunc

from hmap_core.komo.features.base import CALLBACK, KERNEL, Feature
from hmap_core.komo.features.relative import relative_axis, relative_point


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, params, r, J = carray(frames_, 2), carray(params_, 3), carray(r_, 12), carray(J_, (12, n))
    a, b = frames[0], frames[1]
    relative_point(R, p, first, prismatic, a, b, params[0], params[1], params[2], r, J)
    relative_axis(R, first, prismatic, a, b, 1.0, 0.0, 0.0, r, J, 3)
    relative_axis(R, first, prismatic, a, b, 0.0, 1.0, 0.0, r, J, 6)
    relative_axis(R, first, prismatic, a, b, 0.0, 0.0, 1.0, r, J, 9)


def stable(frame: int, reference: int, point=(0.0, 0.0, 0.0)) -> Feature:
    """Where a frame is in a reference, (12,): a point of it in metres, then its x, y and z axes.

    With order 1 as an equality it says that the relative pose, whatever it is, stays. Unlike the quaternion of
    :func:`~hmap_core.komo.features.pose.relative_pose` the axes have no place where they jump or lose their slope: two
    poses that differ by an angle differ by 2 sqrt(2) sin(angle / 2) in the nine numbers together.

    Args:
        frame, reference: numbers of the frames; either may be the one that carries.
        point: (3,) in ``frame``, m; what is there stays to the tolerance (take the contact).
    """
    return Feature("stable", _kernel.address, 12, (frame, reference), np.asarray(point, float), "m, 1", 3)
