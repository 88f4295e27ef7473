"""How far the hand alone, with the object in it, could go: the compiled first filter of contact candidates."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.pairs import pair_distance, place_centers
from hmap_core.collision.simplex import WORK


@nb.njit(**OPTIONS)
def _free(R_obj, p_obj, R_ee, p_ee, R_tip, p_tip, mask, tip, cols, moves, R, p, centers, guesses, witness, work, last):
    """Whether nothing fixed to the tip is too close with the end-effector at (R_ee, p_ee) of the object's frame.

    (R_tip, p_tip) is the tip frame in the end-effector frame; ``last`` (1,) remembers the pair found in the way.
    """
    for i in range(3):
        p[tip, i] = p_obj[i]
        for j in range(3):
            p[tip, i] += R_obj[i, j] * p_ee[j]
            R[tip, i, j] = 0.0
            for k in range(3):
                m = 0.0
                for x in range(3):
                    m += R_obj[i, x] * R_ee[x, k]
                R[tip, i, j] += m * R_tip[k, j]
    for i in range(3):
        for k in range(3):
            m = 0.0
            for x in range(3):
                m += R_obj[i, x] * R_ee[x, k]
            p[tip, i] += m * p_tip[k]
    place_centers(cols, R, p, centers)
    # the pair that was in the way last time is in the way again, more often than not
    for index in range(-1, moves.shape[0]):
        k = last[0] if index < 0 else moves[index]
        if k < 0 or cols.phases[k] & mask == 0:
            continue
        if (
            pair_distance(cols, k, R, p, centers, cols.min_distance[k], guesses[k], witness, work)
            < cols.min_distance[k]
        ):
            last[0] = k
            return False
    return True


@nb.njit(**OPTIONS)
def hand_reach(R_obj, p_obj, R_ee, p_ee, back, R_tip, p_tip, tip, near, far, hold, at_start, on_path):
    """Farthest pose of the object to which each contact could carry it as far as hand and object are concerned.

    Args:
        R_obj, p_obj: (M, 3, 3), (M, 3) object poses.
        R_ee, p_ee: (K, 3, 3), (K, 3) end-effector frames of the contacts, object frame.
        back: (K, 3) where the end-effector draws back to, object frame.
        R_tip, p_tip: tip frame in the end-effector frame; tip: its number.
        near, far, hold: bit masks of phases: touching, in transit, carrying.
        at_start: collision pairs with the object standing at the first pose; on_path: those without the object.

    Returns:
        (K,): index of the pose; -1 where the hand cannot even come to the contact.
    """
    K, M = R_ee.shape[0], R_obj.shape[0]
    bound = np.full(K, -1)
    R, p = np.zeros((tip + 1, 3, 3)), np.zeros((tip + 1, 3))
    for i in range(3):
        R[0, i, i] = 1.0
    witness, work, last = np.empty((3, 3)), np.zeros(WORK), np.full(1, -1)
    moves_start, moves_path = _tip_pairs(at_start, tip), _tip_pairs(on_path, tip)
    centers_start = np.empty((at_start.frame.shape[0], 3))
    centers_path = np.empty((on_path.frame.shape[0], 3))
    guesses_start = np.zeros((at_start.a.shape[0], 9), np.int16)
    guesses_path = np.zeros((on_path.a.shape[0], 9), np.int16)
    for k in range(K):
        last[0] = -1
        if not _free(
            R_obj[0], p_obj[0], R_ee[k], p_ee[k], R_tip, p_tip, near, tip, at_start, moves_start, R, p, centers_start,
            guesses_start, witness, work, last,
        ):  # fmt: skip
            continue
        if not _free(
            R_obj[0], p_obj[0], R_ee[k], back[k], R_tip, p_tip, far, tip, at_start, moves_start, R, p, centers_start,
            guesses_start, witness, work, last,
        ):  # fmt: skip
            continue
        bound[k] = 0
        end = M - 1
        last[0] = -1
        for m in range(1, M):
            if not _free(
                R_obj[m], p_obj[m], R_ee[k], p_ee[k], R_tip, p_tip, hold, tip, on_path, moves_path, R, p, centers_path,
                guesses_path, witness, work, last,
            ):  # fmt: skip
                end = m - 1
                break
        last[0] = -1
        for m in range(end, 0, -1):
            if _free(
                R_obj[m], p_obj[m], R_ee[k], back[k], R_tip, p_tip, far, tip, on_path, moves_path, R, p, centers_path,
                guesses_path, witness, work, last,
            ):  # fmt: skip
                bound[k] = m
                break
    return bound


@nb.njit(**OPTIONS)
def _tip_pairs(cols, tip):
    """Pairs (n,) of a shape fixed to the tip frame with one fixed in the world."""
    chosen = np.empty(cols.a.shape[0], np.int64)
    n = 0
    for k in range(cols.a.shape[0]):
        fa, fb = cols.frame[cols.a[k]], cols.frame[cols.b[k]]
        if (fa == tip and fb == 0) or (fa == 0 and fb == tip):
            chosen[n] = k
            n += 1
    return chosen[:n]
