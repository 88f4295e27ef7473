"""Reduced minimum distances: for paths that begin closer, and for the verification of solutions."""

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.path_collisions import standing_min_distances

RELAXATION = 1e-4  # m: what a minimum distance is lowered by beyond what the start needs
# Between the steps a pair may come nearer than its minimum distance by this share of it, and at least by this much, m.
VERIFY_SHARE = 2.0 / 3.0
VERIFY_SLACK = 0.0005


def verification(cols: Collisions) -> Collisions:
    """The same pairs with what an executed path may use up of their minimum distances."""
    return cols._replace(min_distance=cols.min_distance - np.maximum(VERIFY_SLACK, VERIFY_SHARE * cols.min_distance))


def relaxed(chain: Chain, cols: Collisions, q: np.ndarray, phases: int) -> Collisions:
    """The same pairs, with minimum distances lowered where the configuration q (n,) is already nearer than they ask.

    A path that starts there can then be feasible; it may leave, and never come nearer than it stands.
    """
    q = np.ascontiguousarray(q, float)
    return cols._replace(min_distance=standing_min_distances(q, np.int64(phases), chain, cols, RELAXATION))
