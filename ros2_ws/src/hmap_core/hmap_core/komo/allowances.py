"""Margins that are lowered: where a path begins too near, and for the verification of what was found."""

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.solver import path_violations, standing_margins

RELAXATION = 1e-4  # m: what a margin is lowered by beyond what the start needs
# Between the steps a pair may come nearer than its margin by this share of it, and at least by this much, m.
VERIFY_SHARE = 2.0 / 3.0
VERIFY_SLACK = 0.0005


def clearance(chain: Chain, cols: Collisions, path: np.ndarray, phase: np.ndarray, floor: float = -1e3):
    """Worst margin violation of each configuration of a path (M, n) in its phase (M,).

    Returns:
        (violation (M,), pair (M,)): margin minus distance in metres, positive where too close; pair -1 when nothing
        exceeds ``floor``.
    """
    return path_violations(np.ascontiguousarray(path, float), 1 << np.asarray(phase, np.int64), chain, cols, floor)


def verification(cols: Collisions) -> Collisions:
    """The same pairs with what an executed path may use up of their margins."""
    return cols._replace(margin=cols.margin - np.maximum(VERIFY_SLACK, VERIFY_SHARE * cols.margin))


def without_pairs(cols: Collisions) -> Collisions:
    """The same shapes with no pair to keep apart."""
    none = np.zeros(0, np.int64)
    return cols._replace(a=none, b=none, margin=np.zeros(0), phases=none, closing=np.zeros(0))


def relaxed(chain: Chain, cols: Collisions, q: np.ndarray, phases: int) -> Collisions:
    """The same pairs, with margins lowered where the configuration q (n,) is already nearer than they ask.

    A path that starts there can then be feasible; it may leave, and never come nearer than it stands.
    """
    q = np.ascontiguousarray(q, float)
    return cols._replace(margin=standing_margins(q, np.int64(phases), chain, cols, RELAXATION))
