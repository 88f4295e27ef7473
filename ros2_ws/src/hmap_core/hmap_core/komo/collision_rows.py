"""The collision pairs in the model of a solve: which are looked at, and what they add, compiled."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, PLAIN
from hmap_core.collision.pairs import BEYOND, move_on, pair_distance, place_centers
from hmap_core.kinematics.tree import point_jacobian

LOOK_AHEAD = 0.01  # m beyond what matters to which a distance is found, so that a pair can be left alone for a while
NEVER = BEYOND * BEYOND  # slack (m) of pairs that a phase does not ask for


@nb.njit(**INLINE)
def visit(X, prefix, t, alpha, reach, sample, qs, seen, travel):
    """Writes the configuration of a sample to qs; returns how far anything may have moved there so far."""
    moved = 0.0
    for i in range(qs.shape[0]):
        before = X[t - 1, i] if t > 0 else prefix[1, i]
        q = (1 - alpha) * before + alpha * X[t, i]
        moved += reach[i] * abs(q - seen[sample, i])
        seen[sample, i] = q
        qs[i] = q
    travel[sample] += moved
    return travel[sample]


@nb.njit(**PLAIN)
def _begin(cols, s, sample, mask, R, p):
    """What is known of a sample at first: what is known of the one before it, from which it is a small motion away."""
    slack, phases = s.slack[sample], cols.phases
    P = phases.shape[0]
    before = sample - 1
    if before < 0 or not s.known[before]:
        place_centers(cols, R, p, s.centers[sample])
        for f in range(R.shape[0]):
            for x in range(3):
                for y in range(3):
                    s.turned[sample, f, x, y] = R[f, x, y]
        for k in range(P):
            slack[k] = 0.0 if phases[k] & mask else NEVER
            s.guesses[sample, k, 0] = 0
    else:
        for i in range(s.centers.shape[1]):
            for x in range(3):
                s.centers[sample, i, x] = s.centers[before, i, x]
        for f in range(R.shape[0]):
            for x in range(3):
                for y in range(3):
                    s.turned[sample, f, x, y] = s.turned[before, f, x, y]
        for k in range(P):
            known = s.slack[before, k]
            slack[k] = NEVER if phases[k] & mask == 0 else (known if known < 0.5 * NEVER else 0.0)
            for h in range(s.guesses.shape[2]):
                s.guesses[sample, k, h] = s.guesses[before, k, h]
    s.known[sample] = True


@nb.njit(**PLAIN)
def collide(cols, chain, s, sample, mask, t, alpha, R, p, mu, lam, detection_distance, model):
    """Looks at the pairs of one sample with the frames (R, p), whose multipliers are lam (P,).

    Adds those nearer than their minimum distance plus ``detection_distance`` to the rows of the model. Returns
    (penalty, worst violation).
    """
    if not s.known[sample]:
        _begin(cols, s, sample, mask, R, p)
    centers, slack, guesses, w = s.centers[sample], s.slack[sample], s.guesses[sample], s.witness
    move_on(cols, R, p, centers, s.turned[sample], s.moved, slack)
    A, B, min_distance, bound, closing = cols.a, cols.b, cols.min_distance, cols.bound, cols.closing
    first, prismatic = chain.first, chain.prismatic
    penalty = 0.0
    worst = -BEYOND
    rest = NEVER
    for k in range(A.shape[0]):
        pulls = lam[k] > 0.0
        if slack[k] > 0.0 and not pulls:
            rest = min(rest, slack[k] / closing[k])
            continue
        a, b = A[k], B[k]
        near = min_distance[k] + detection_distance
        if not pulls:
            d0 = centers[a, 0] - centers[b, 0]
            d1 = centers[a, 1] - centers[b, 1]
            d2 = centers[a, 2] - centers[b, 2]
            gap = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) - bound[a] - bound[b] - near
            if gap > 0.0:
                slack[k] = gap
                rest = min(rest, gap / closing[k])
                continue
        d = pair_distance(cols, k, R, p, centers, BEYOND if pulls else near + LOOK_AHEAD, guesses[k], w, s.work)
        c = min_distance[k] - d
        worst = max(worst, c)
        slack[k] = d - near
        rest = 0.0 if pulls else min(rest, max(0.0, d - near) / closing[k])
        if d > near and not pulls:
            continue
        m = model.count[0]
        model.count[0] = m + 1
        row = model.row[m]
        row[:] = 0.0
        fa, fb = cols.frame[a], cols.frame[b]
        point_jacobian(R, p, first, prismatic, fa, w[1, 0], w[1, 1], w[1, 2], w[0, 0], w[0, 1], w[0, 2], -1.0, row)
        point_jacobian(R, p, first, prismatic, fb, w[2, 0], w[2, 1], w[2, 2], w[0, 0], w[0, 1], w[0, 2], 1.0, row)
        shifted = c + lam[k] / mu
        model.step[m], model.alpha[m], model.value[m], model.weight[m] = t, alpha, shifted, mu
        model.sample[m], model.pair[m] = sample, k
        if shifted > 0.0:
            penalty += 0.5 * mu * shifted * shifted
    s.wake[sample] = s.travel[sample] + rest
    return penalty, worst


@nb.njit(**PLAIN)
def update_pairs(mult, model, s, old):
    """Updates the multipliers of the pairs from the rows of a model that was made with the penalty ``old``.

    Keeps these rows, with the new multipliers and penalty, and drops all others. Pairs without a row have no multiplier
    and are too far for one. Returns (penalty, worst violation, largest change of a multiplier / old).
    """
    mu = mult.mu[0]
    penalty = 0.0
    worst = -BEYOND
    change = 0.0
    kept = 0
    for m in range(model.count[0]):
        sample, pair = model.sample[m], model.pair[m]
        if pair < 0:
            continue
        lam = mult.pairs[sample, pair]
        c = model.value[m] - lam / old
        updated = max(0.0, lam + old * c)
        mult.pairs[sample, pair] = updated
        if updated > 0.0:
            s.wake[sample] = s.travel[sample]
        worst = max(worst, c)
        change = max(change, abs(updated - lam) / old)
        shifted = c + updated / mu
        if shifted > 0.0:
            penalty += 0.5 * mu * shifted * shifted
        if kept < m:
            for i in range(model.row.shape[1]):
                model.row[kept, i] = model.row[m, i]
            model.step[kept], model.alpha[kept] = model.step[m], model.alpha[m]
            model.sample[kept], model.pair[kept] = sample, pair
        model.value[kept], model.weight[kept] = shifted, mu
        kept += 1
    model.count[0] = kept
    return penalty, worst, change
