"""The augmented Lagrangian of a path problem at a path, and its model there, compiled."""

import numba as nb

from hmap_core.collision.compile_options import PLAIN
from hmap_core.collision.pairs import BEYOND
from hmap_core.kinematics.tree import forward
from hmap_core.komo.collision_rows import collide, update_pairs, visit
from hmap_core.komo.objective_rows import add_objectives
from hmap_core.komo.scratch import MAX_ORDER


@nb.njit(**PLAIN)
def _smoothness(X, prefix, w_acc, w_vel, H, G):
    """Adds squared accelerations and velocities of the path after ``prefix`` (2, n), the two configurations before."""
    T, n = X.shape
    cost = 0.0
    for t in range(T):
        for i in range(n):
            x1 = X[t - 1, i] if t >= 1 else prefix[1, i]
            x2 = X[t - 2, i] if t >= 2 else (prefix[1, i] if t == 1 else prefix[0, i])
            a = X[t, i] - 2 * x1 + x2
            v = X[t, i] - x1
            cost += 0.5 * w_acc * a * a + 0.5 * w_vel * v * v
            k = n * t + i
            G[k] += w_acc * a + w_vel * v
            H[k, 0] += w_acc + w_vel
            if t >= 1:
                G[k - n] -= 2 * w_acc * a + w_vel * v
                H[k - n, 0] += 4 * w_acc + w_vel
                H[k - n, n] -= 2 * w_acc + w_vel
            if t >= 2:
                G[k - 2 * n] += w_acc * a
                H[k - 2 * n, 0] += w_acc
                H[k - 2 * n, n] -= 2 * w_acc
                H[k - 2 * n, 2 * n] += w_acc
    return cost


@nb.njit(**PLAIN)
def evaluate(X, prefix, chain, terms, cols, samples, o, mult, model, s, old):
    """Augmented Lagrangian at X, and its model there.

    With ``old``, the penalty so far, ``model`` has to be the one at X with it: the multipliers are updated by it, as
    l += old c where that is active, and its pairs are not looked at again.

    Returns (merit, cost, worst equality, worst inequality, change): the worst values are unscaled, in metres and
    radians; change is the largest change of a multiplier over ``old``: violations, and slack where one is active.
    """
    T, n = X.shape
    mu = mult.mu[0]
    H, G = model.H, model.G
    H[:] = 0.0
    G[:] = 0.0
    cost = _smoothness(X, prefix, o.acceleration, o.velocity, H, G)
    merit = cost
    change = 0.0
    worst_eq = 0.0
    worst_ineq = -BEYOND
    anew = old <= 0.0
    if anew:
        model.count[0] = 0
    else:
        penalty, worst_ineq, change = update_pairs(mult, model, s, old)
        merit += penalty
    parent, R_joint, p_joint, prismatic = chain.parent, chain.R_joint, chain.p_joint, chain.prismatic
    lower, upper, reach, limits = chain.lower, chain.upper, chain.reach, mult.limits
    first, alphas, masks, by_sample = samples.first, samples.alpha, samples.mask, terms.by_sample
    qs, seen, travel, wake, Hs, gs = s.qs, s.seen, s.travel, s.wake, s.Hs, s.gs
    several = s.R.shape[0] > 1
    for t in range(T):
        for sample in range(first[t], first[t + 1]):
            alpha = alphas[sample]
            step = sample + 1 == first[t + 1]
            moved = visit(X, prefix, t, alpha, reach, sample, qs, seen, travel)
            asks = (step and several) or by_sample[sample] < by_sample[sample + 1]
            awake = anew and moved >= wake[sample]
            if not (asks or awake):
                continue
            index = t + MAX_ORDER if step and several else 0
            R, p = (s.R[index], s.p[index]) if step else (s.Rm, s.pm)
            forward(qs, parent, R_joint, p_joint, prismatic, R, p)
            if awake:
                penalty, worst = collide(
                    cols,
                    chain,
                    s,
                    sample,
                    masks[sample],
                    t,
                    alpha,
                    R,
                    p,
                    mu,
                    mult.pairs[sample],
                    o.detection_distance,
                    model,
                )
                merit += penalty
                worst_ineq = max(worst_ineq, worst)
            if asks:
                Hs[:] = 0.0
                gs[:] = 0.0
                m, c, we, wi, moved = add_objectives(
                    X, prefix, t, sample, alpha, R, p, chain, terms, mu, mult.terms, s, model, old
                )  # fmt: skip
                change = max(change, moved)
                merit += m
                cost += c
                worst_eq = max(worst_eq, we)
                worst_ineq = max(worst_ineq, wi)
                beta = 1.0 - alpha
                before = t > 0 and beta > 0.0
                for i in range(n):
                    k = n * t + i
                    G[k] += alpha * gs[i]
                    for j in range(i + 1):
                        H[k - i + j, i - j] += alpha * alpha * Hs[i, j]
                    if before:
                        G[k - n] += beta * gs[i]
                        for j in range(n):
                            h = Hs[i, j] if j <= i else Hs[j, i]
                            H[k - n - i + j, n + i - j] += alpha * beta * h
                            if j <= i:
                                H[k - n - i + j, i - j] += beta * beta * h
        for i in range(n):
            for side in range(2):
                c = lower[i] - X[t, i] if side == 0 else X[t, i] - upper[i]
                worst_ineq = max(worst_ineq, c)
                if old > 0.0:
                    updated = max(0.0, limits[t, i, side] + old * c)
                    change = max(change, abs(updated - limits[t, i, side]) / old)
                    limits[t, i, side] = updated
                shifted = c + limits[t, i, side] / mu
                if shifted > 0.0:
                    merit += 0.5 * mu * shifted * shifted
    return merit, cost, worst_eq, worst_ineq, change
