"""Reduced minimum distances: for paths that begin closer, and for the verification of solutions."""

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.path_collisions import standing_min_distances

RELAXATION = 1e-4  # m: what a minimum distance is lowered by beyond what the start needs
# Between the steps a pair may come nearer than its minimum distance by this share of it, and at least by this much, m.
VERIFY_SHARE = 2.0 / 3.0
VERIFY_SLACK = 0.0005
OVERLAP_ALLOWED = 0.001  # m that two parts may overlap where a motion starts or ends; the judge of plans allows as much
CHORDS = 1e-4  # m that a path may overlap more than the chords at which it is verified
ROUNDING = 1e-6  # m


def verification(cols: Collisions) -> Collisions:
    """The same pairs with what an executed path may use up of their minimum distances.

    No path may overlap by more than OVERLAP_ALLOWED because of that, and its chords by CHORDS less.
    """
    used_up = cols.min_distance - np.maximum(VERIFY_SLACK, VERIFY_SHARE * cols.min_distance)
    return cols._replace(min_distance=np.maximum(used_up, np.minimum(cols.min_distance, CHORDS - OVERLAP_ALLOWED)))


def relaxed(chain: Chain, cols: Collisions, q: np.ndarray, phases: int) -> Collisions:
    """The same pairs, with minimum distances lowered where the configuration q (n,) is already nearer than they ask.

    A path that starts there can then be feasible; it may leave, and come nearer than it stands by RELAXATION, but not
    to overlap by more than OVERLAP_ALLOWED.
    """
    q = np.ascontiguousarray(q, float)
    lowered = standing_min_distances(q, np.int64(phases), chain, cols, RELAXATION)
    deepest = np.minimum(lowered + RELAXATION - ROUNDING, -OVERLAP_ALLOWED)
    return cols._replace(min_distance=np.where(lowered < cols.min_distance, np.maximum(lowered, deepest), lowered))
