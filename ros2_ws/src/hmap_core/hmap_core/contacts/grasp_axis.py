"""Grasps about another closing axis: what is round between the pads can be held in other directions as well."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.contacts.candidates import Hand
from hmap_core.contacts.grasp import across, depth_below, fits_between
from hmap_core.contacts.solids import Solids
from hmap_core.transforms import quaternions
from hmap_core.types import ContactPoint

FLUSH = float(np.cos(np.deg2rad(1.0)))  # cosine of the largest angle between a pad's normal and the object's


def turned_grasps(
    contacts: Sequence[ContactPoint],
    R: np.ndarray,
    own: Solids,
    hand: Hand,
    allowed: Callable[[np.ndarray], np.ndarray],
) -> list[ContactPoint]:
    """Grasps at the same middle between the pads with other orientations of the hand.

    Args:
        contacts: K grasps.
        R: (K, 3, 3) orientations, object frame.
        own: the object's shapes.
        hand: the fingers.
        allowed: maps points (N, 3) to whether contacts can lie there (N,).

    Returns:
        Each grasp with its new orientation, unchanged where a pad would not be flush with the object.
    """
    normals = np.array([contact.normal for contact in contacts])
    middle = np.array([contact.point - 0.5 * contact.opening * contact.normal for contact in contacts])
    side = np.where(np.einsum("ki,ki->k", R[:, :, 1], normals) < 0.0, -1.0, 1.0)
    axes = np.ascontiguousarray(R[:, :, 1] * side[:, None])
    points = middle + depth_below(middle, axes, *own.arrays)[:, None] * axes
    width, far = across(points, axes, *own.arrays)
    opposite = points - width[:, None] * axes
    _, near = across(opposite, -axes, *own.arrays)
    flush = (np.einsum("ki,ki->k", near, axes) >= FLUSH) & (np.einsum("ki,ki->k", far, -axes) >= FLUSH)
    good = flush & fits_between(width, hand) & allowed(points) & allowed(opposite)
    turned, found = np.concatenate([0.5 * (points + opposite), quaternions(R)], axis=1), list(contacts)
    for k in np.flatnonzero(good):
        opening = float(width[k])
        found[k] = replace(found[k], T_obj_ee=turned[k], point=points[k], normal=axes[k], opening=opening)
    return found
