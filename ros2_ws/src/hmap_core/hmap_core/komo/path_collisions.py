"""Distances of the collision pairs along given configurations, compiled."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS, PLAIN
from hmap_core.collision.pairs import move_on, pair_distance, place_centers
from hmap_core.collision.simplex import WORK
from hmap_core.kinematics.tree import forward
from hmap_core.komo.collision_rows import LOOK_AHEAD


@nb.njit(**PLAIN)
def _nearest(
    path, masks, chain, cols, floor, violation, pair, R, p, turned, centers, moved, slack, guesses, witness, work
):
    """:func:`path_violations` with room for everything."""
    for m in range(path.shape[0]):
        forward(path[m], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        if m == 0:
            place_centers(cols, R, p, centers)
        move_on(cols, R, p, centers, turned, moved, slack)
        for k in range(slack.shape[0]):
            if slack[k] > 0.0 or cols.phases[k] & masks[m] == 0:
                continue
            min_distance = cols.min_distance[k]
            d = pair_distance(cols, k, R, p, centers, min_distance - floor + LOOK_AHEAD, guesses[k], witness, work)
            slack[k] = d - min_distance + floor
            if min_distance - d > violation[m]:
                violation[m] = min_distance - d
                pair[m] = k


@nb.njit(**OPTIONS)
def path_violations(path, masks, chain, cols, floor):
    """Worst minimum distance violation of each configuration.

    Args:
        path: (M, n); masks: (M,) bit mask of phases of each.
        floor: violations below this are not looked for, m.

    Returns:
        (violation (M,) in metres, positive where a pair is closer than its minimum distance; pair (M,), -1 where
        none > floor).
    """
    M, n = path.shape
    P, shapes = cols.a.shape[0], cols.frame.shape[0]
    violation, pair = np.full(M, floor), np.full(M, -1, np.int64)
    _nearest(
        path, masks, chain, cols, floor, violation, pair, np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3, 3)), np.zeros((shapes, 3)), np.zeros(shapes), np.zeros(P), np.zeros((P, 9), np.int16),
        np.zeros((3, 3)), np.zeros(WORK),
    )  # fmt: skip
    return violation, pair


@nb.njit(**OPTIONS)
def standing_min_distances(q, mask, chain, cols, extra):
    """Minimum distances (P,) of the pairs; where the configuration q (n,) has less, that less ``extra`` (m)."""
    n = q.shape[0]
    R, p, centers = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((cols.frame.shape[0], 3))
    guess, witness, work = np.zeros(9, np.int16), np.zeros((3, 3)), np.zeros(WORK)
    forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
    place_centers(cols, R, p, centers)
    min_distance = cols.min_distance.copy()
    for k in range(min_distance.shape[0]):
        if cols.phases[k] & mask:
            guess[0] = 0
            d = pair_distance(cols, k, R, p, centers, min_distance[k], guess, witness, work)
            if d < min_distance[k]:
                min_distance[k] = d - extra
    return min_distance


@nb.njit(**OPTIONS)
def penetration(path, masks, chain, cols):
    """Sum (m) over the configurations of a path (M, n) of their worst violations of the minimum distances."""
    total = 0.0
    violation, _ = path_violations(path, masks, chain, cols, 0.0)
    for m in range(path.shape[0]):
        total += violation[m]
    return total
