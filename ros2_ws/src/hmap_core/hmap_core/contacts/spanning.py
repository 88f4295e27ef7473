"""Grasps across a hollow body: the fingers close on opposite outer faces, with a gap between the walls behind them."""

import numpy as np
from numba import njit

from hmap_core.contacts.camera import SKIN, Cloud
from hmap_core.contacts.candidates import Hand
from hmap_core.contacts.grasp import across, fits_between
from hmap_core.contacts.solids import Solids, interval, outward_normal

LEAST_GAP = 1e-3  # m; with less space between the walls, the grasp is one through solid material


@njit(cache=True, error_model="numpy", nogil=True)
def across_outside(points, normals, reach, kind, R, p, size, planes, start):
    """Width of the body behind each outermost point, gaps included.

    Args:
        points, normals: (N, 3) of the surface.
        reach: m, more than the size of the body.
        kind, R, p, size, planes, start: the arrays of :class:`hmap_core.contacts.solids.Solids`.

    Returns:
        Width (N,) in m along -normal up to the outermost far side, 0 where material lies ahead of the point; and the
        outward normals (N, 3) of the far side.
    """
    width = np.zeros(points.shape[0])
    far = np.zeros(points.shape)
    t = np.empty(2)
    for i in range(points.shape[0]):
        outermost = True
        nearest, which = np.inf, -1
        origin = points[i] - reach * normals[i]
        for s in range(kind.shape[0]):
            interval(s, origin, normals[i], kind, R, p, size, planes, start, t)
            if t[0] > t[1]:
                continue
            if t[1] > reach + SKIN:
                outermost = False
                break
            if t[0] < nearest:
                nearest, which = t[0], s
        if outermost and which >= 0:
            width[i] = reach - nearest
            far[i] = outward_normal(which, origin + nearest * normals[i], kind, R, p, size, planes, start)
    return width, far


def antipodal_outside(cloud: Cloud, own: Solids, hand: Hand, friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Find antipodal grasp points on outermost faces with a gap between them.

    Args:
        cloud: surface points, object frame.
        own: the object's shapes.
        hand: its gripper limits the width.
        friction: coefficient of the object.

    Returns:
        (N,) whether there is a gap, and the opposite face is within the friction cone and the gripper's range; and
        widths (N,) in m.
    """
    reach = 2.0 * float(np.ptp(cloud.points, axis=0).sum())
    width, far = across_outside(cloud.points, cloud.normals, reach, *own.arrays)
    solid, _ = across(cloud.points, cloud.normals, *own.arrays)
    opposite = -np.einsum("ij,ij->i", far, cloud.normals) >= np.cos(np.arctan(friction))
    return opposite & fits_between(width, hand) & (width > solid + LEAST_GAP), width
