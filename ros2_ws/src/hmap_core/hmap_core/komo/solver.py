"""Augmented-Lagrangian Gauss-Newton on the banded structure of a path problem (KOMO [1, 2]), compiled.

The path x (T, n) minimises weighted squared velocities and accelerations plus the sos objectives, subject to eq and
ineq objectives at their steps, joint limits at every step, and the collision pairs at every step *and* at samples
between the steps, on the straight line between two configurations. Every constraint component has its own multiplier;
convergence asks the worst component, in metres and radians, never a sum.

[1] Toussaint, A tutorial on Newton methods for constrained trajectory optimization, 2017.
[2] Nocedal and Wright, Numerical Optimization, 2006, ch. 17.4.
"""

import numba as nb
import numpy as np

from hmap_core.collision.gjk import INLINE, OPTIONS, PLAIN, WORK
from hmap_core.collision.pairs import BEYOND, move_on, pair_distance, place_centers
from hmap_core.kinematics.tree import forward, point_jacobian
from hmap_core.komo.arrays import BAND, EQ, INEQ, SOS, Model, Multipliers, Options, Samples, Scratch, Terms
from hmap_core.komo.banded import PADDING, cholesky_solve
from hmap_core.komo.features.base import MAX_DIM, call_kernel

MAX_ORDER = 2
# a round that leaves more than this share of the violation stalls; after so many in a row the solve ends
STALL, STALLS = 0.8, 8
MODEL_ROUNDS = 6  # systems solved for one step, at most
# shares of what the slope promises (a quadratic gives half) below which a step is refused, the next one is damped
# more, and above which it is damped less
LEAST_GAIN, POOR_GAIN, GOOD_GAIN = 0.01, 0.15, 0.35
TRIES = 10  # steps tried from one path, with more and more damping
NO_NUMBER = 1e300  # a merit that is not below this is no number: some target or parameter is none
ENOUGH = 0.25  # share of the last round's violation from which the penalty is left as it is
LOOK_AHEAD = 0.01  # m beyond what matters to which a distance is found, so that a pair can be left alone for a while
NEVER = BEYOND * BEYOND  # slack (m) of pairs that a phase does not ask for
ROUGH = 1e-2  # m, rad: how near its target a configuration has to come before its collisions are looked at


@nb.njit(**OPTIONS)
def new_multipliers(T, n, terms, cols, samples, mu):
    """Multipliers to begin with: none is active yet."""
    return Multipliers(
        np.zeros((terms.kernel.shape[0], MAX_DIM)), np.zeros((samples.alpha.shape[0], cols.a.shape[0])),
        np.zeros((T, n, 2)), np.full(1, mu),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def new_scratch(T, n, chain, terms, cols, samples, prefix):
    """Scratch for a problem of T steps."""
    P, S = cols.a.shape[0], samples.alpha.shape[0]
    order = 0
    for m in range(terms.order.shape[0]):
        order = max(order, terms.order[m])
    kept = T + MAX_ORDER if order > 0 else 1
    R, p = np.zeros((kept, n + 1, 3, 3)), np.zeros((kept, n + 1, 3))
    if order > 0:
        for k in range(MAX_ORDER):
            forward(prefix[k], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[k], p[k])
    shapes = cols.frame.shape[0]
    return Scratch(
        R, p, np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n, n)), np.zeros(n),
        np.zeros((3, 3)), np.zeros(WORK), np.zeros(MAX_DIM), np.zeros(MAX_DIM), np.zeros((MAX_DIM, n)),
        np.zeros((MAX_ORDER + 1, MAX_DIM, n)), np.zeros(n), np.zeros((S, n)), np.zeros(S), np.zeros(S),
        np.zeros(S, np.bool_), np.empty((S, shapes, 3)), np.empty((S, n + 1, 3, 3)), np.empty((S, P)),
        np.empty((S, P, 9), np.int16), np.zeros(shapes),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def new_model(T, n, terms, cols, samples):
    """Room for the model of a problem of T steps."""
    M = samples.alpha.shape[0] * cols.a.shape[0] + 1
    for m in range(terms.dim.shape[0]):
        M += terms.dim[m]
    return Model(
        np.zeros((T * n, 3 * n + PADDING)), np.zeros(T * n), np.empty((M, n)), np.empty(M, np.int64), np.empty(M),
        np.empty(M), np.empty(M), np.empty(M, np.int64), np.empty(M, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip


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


@nb.njit(**INLINE)
def _visit(X, prefix, t, alpha, reach, sample, qs, seen, travel):
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
def _collide(cols, chain, s, sample, mask, t, alpha, R, p, mu, lam, detection_distance, model):
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
def _update_pairs(mult, model, s, old):
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


@nb.njit(**INLINE)
def _call(terms, m, n, chain, R, p, q, r, J):
    """Value r and Jacobian J of term m at the configuration q with the frames (R, p)."""
    J[: terms.dim[m]] = 0.0
    call_kernel(
        terms.kernel[m], n, R.ctypes.data, p.ctypes.data, chain.first.ctypes.data, chain.prismatic.ctypes.data,
        q.ctypes.data, terms.frames[m].ctypes.data, terms.params[terms.offset[m] :].ctypes.data, r.ctypes.data,
        J.ctypes.data,
    )  # fmt: skip


@nb.njit(**PLAIN)
def _value(X, prefix, t, m, chain, terms, s):
    """Value of term m at step t, less its target, into s.r; its Jacobians by x_t, x_(t-1), x_(t-2) into s.Jk."""
    n = X.shape[1]
    dim, order = terms.dim[m], terms.order[m]
    s.r[:dim] = 0.0
    scale = 1.0 / terms.tau**order
    weight = scale  # binomial, with alternating sign
    for k in range(order + 1):
        step = t - k
        q = X[step] if step >= 0 else prefix[MAX_ORDER + step]
        index = step + MAX_ORDER
        _call(terms, m, n, chain, s.R[index], s.p[index], q, s.rk, s.Jk[k])
        for d in range(dim):
            s.r[d] += weight * s.rk[d]
            for i in range(n):
                s.Jk[k, d, i] *= weight
        weight *= -(order - k) / (k + 1)
    for d in range(dim):
        s.r[d] -= terms.target[m, d]


@nb.njit(**PLAIN)
def _objectives(X, prefix, t, sample, alpha, R, p, chain, terms, mu, lam, s, model, old):
    """Adds the objectives of a sample: to s.Hs, s.gs, those that look at several steps and inequalities to the model.

    With ``old``, a penalty, their multipliers are updated before. Returns (merit, cost, worst equality, worst
    inequality, largest change of a multiplier / old).
    """
    n = X.shape[1]
    H, G = model.H, model.G
    change = 0.0
    merit = 0.0
    cost = 0.0
    worst_eq = 0.0
    worst_ineq = -BEYOND
    for m in range(terms.by_sample[sample], terms.by_sample[sample + 1]):
        dim, kind, order = terms.dim[m], terms.type[m], terms.order[m]
        if order == 0:
            _call(terms, m, n, chain, R, p, s.qs, s.r, s.J)
            for d in range(dim):
                s.r[d] -= terms.target[m, d]
        else:
            _value(X, prefix, t, m, chain, terms, s)
        for d in range(dim):
            weight = terms.scale[m]
            value = s.r[d]
            sign = 1.0
            if kind == BAND:
                sign = 1.0 if value > 0.0 else -1.0
                value = abs(value) - terms.band[m, d]
            one_sided = kind == INEQ or kind == BAND
            if kind != SOS:
                if one_sided:
                    worst_ineq = max(worst_ineq, value)
                else:
                    worst_eq = max(worst_eq, abs(value))
                if old > 0.0:
                    updated = lam[m, d] + old * weight * value
                    if one_sided:
                        updated = max(0.0, updated)
                    change = max(change, abs(updated - lam[m, d]) / (old * weight))
                    lam[m, d] = updated
                weight *= mu
                value += lam[m, d] / weight
            half = 0.5 * weight * value * value
            if one_sided and value <= 0.0:
                half = 0.0
            merit += half
            if kind == SOS:
                cost += half
            if order == 0 and one_sided:
                c = model.count[0]
                model.count[0] = c + 1
                model.step[c], model.alpha[c], model.value[c], model.weight[c] = t, alpha, value, weight
                model.pair[c] = -1
                for i in range(n):
                    model.row[c, i] = sign * s.J[d, i]
            elif order == 0:
                for i in range(n):
                    g = weight * s.J[d, i]
                    if g != 0.0:
                        s.gs[i] += g * value
                        for j in range(i + 1):
                            s.Hs[i, j] += g * s.J[d, j]
            elif half > 0.0:
                for a in range(min(order, t) + 1):
                    for i in range(n):
                        g = weight * s.Jk[a, d, i]
                        if g == 0.0:
                            continue
                        row = n * (t - a) + i
                        G[row] += g * value
                        for j in range(i, n):
                            H[row, j - i] += g * s.Jk[a, d, j]
                        for b in range(a):
                            for j in range(n):
                                H[row, n * (a - b) + j - i] += g * s.Jk[b, d, j]
    return merit, cost, worst_eq, worst_ineq, change


@nb.njit(**PLAIN)
def _evaluate(X, prefix, chain, terms, cols, samples, o, mult, model, s, old):
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
        penalty, worst_ineq, change = _update_pairs(mult, model, s, old)
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
            moved = _visit(X, prefix, t, alpha, reach, sample, qs, seen, travel)
            asks = (step and several) or by_sample[sample] < by_sample[sample + 1]
            awake = anew and moved >= wake[sample]
            if not (asks or awake):
                continue
            index = t + MAX_ORDER if step and several else 0
            R, p = (s.R[index], s.p[index]) if step else (s.Rm, s.pm)
            forward(qs, parent, R_joint, p_joint, prismatic, R, p)
            if awake:
                penalty, worst = _collide(
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
                m, c, we, wi, moved = _objectives(
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


@nb.njit(**PLAIN)
def _assemble(X, prefix, chain, mult, model, step, A, b):
    """The normal equations A, b of the model with the inequalities that are active after a step (T n,).

    Returns how many are active, as a checksum that tells different sets apart.
    """
    T, n = X.shape
    mu = mult.mu[0]
    H, G = model.H, model.G
    for k in range(T * n):
        for j in range(H.shape[1]):
            A[k, j] = H[k, j]
        b[k] = -G[k]
    active = 0
    for m in range(model.count[0]):
        t, alpha, row, value, weight = model.step[m], model.alpha[m], model.row[m], model.value[m], model.weight[m]
        beta = 1.0 - alpha
        before = t > 0 and beta > 0.0
        predicted = value
        k = n * t
        for i in range(n):
            predicted += alpha * row[i] * step[k + i]
            if before:
                predicted += beta * row[i] * step[k - n + i]
        if predicted <= 0.0:
            continue
        active += (m + 1) * (m + 7)
        for i in range(n):
            g = weight * row[i]
            if g == 0.0:
                continue
            b[k + i] -= alpha * g * value
            for j in range(i, n):
                A[k + i, j - i] += alpha * alpha * g * row[j]
            if before:
                b[k - n + i] -= beta * g * value
                for j in range(i, n):
                    A[k - n + i, j - i] += beta * beta * g * row[j]
                for j in range(n):
                    A[k - n + i, n + j - i] += alpha * beta * g * row[j]
    for t in range(T):
        for i in range(n):
            k = n * t + i
            for side in range(2):
                sign = -1.0 if side == 0 else 1.0
                c = chain.lower[i] - X[t, i] if side == 0 else X[t, i] - chain.upper[i]
                value = c + mult.limits[t, i, side] / mu
                if value + sign * step[k] > 0.0:
                    active += (k + 1) * (k + 11) * (side + 3)
                    b[k] -= mu * value * sign
                    A[k, 0] += mu
    return active


@nb.njit(**PLAIN)
def _model_step(X, prefix, chain, mult, model, damping, bandwidth, A, b, gradient, step):
    """The step (T n,) that minimises the model, and the gradient at X.

    The model is quadratic but for the inequalities, which are active or not; which ones is asked of the step itself,
    until that does not change (a semi-smooth Newton method [4]): a step does not run into what it did not feel before.

    [4] Hintermueller, Ito, Kunisch, The primal-dual active set strategy as a semismooth Newton method, 2002.

    Returns False where the normal equations are not positive definite.
    """
    N = step.shape[0]
    step[:] = 0.0
    before = 0
    for attempt in range(MODEL_ROUNDS):
        active = _assemble(X, prefix, chain, mult, model, step, A, b)
        if attempt == 0:
            for k in range(N):
                gradient[k] = -b[k]
        elif active == before:
            return True
        before = active
        for k in range(N):
            A[k, 0] += damping
        if not cholesky_solve(A, b, bandwidth):
            return False
        for k in range(N):
            step[k] = b[k]
    return True


@nb.njit(**OPTIONS)
def solve_from(X, prefix, chain, terms, cols, samples, o, mult, s):
    """Solves one problem in place, from X (T, n) and the multipliers ``mult``, which are updated.

    Args:
        X: path (T, n), start and result.
        prefix: the two configurations (2, n) before the path.
        chain, terms, cols, samples, o, mult, s: see :mod:`hmap_core.komo.arrays`, :mod:`hmap_core.kinematics.chain`
            and :mod:`hmap_core.collision.scene_model`.

    Returns:
        (cost, worst equality, worst inequality, iterations).
    """
    T, n = X.shape
    N = T * n
    band = 3 * n
    model, trial_model = new_model(T, n, terms, cols, samples), new_model(T, n, terms, cols, samples)
    A, b, gradient, step = np.zeros((N, band + PADDING)), np.zeros(N), np.zeros(N), np.zeros(N)
    Xn = np.zeros((T, n))
    bandwidth = min(band - 1, N - 1)
    damping = o.damping
    iterations = 0
    cost = 0.0
    worst_eq = BEYOND
    worst_ineq = BEYOND
    before = BEYOND
    stalled = 0
    old = 0.0  # the penalty by which the multipliers are to be updated
    for _outer in range(int(o.outer)):
        merit, cost, worst_eq, worst_ineq, change = _evaluate(
            X, prefix, chain, terms, cols, samples, o, mult, model, s, old
        )
        if old > 0.0 and max(worst_eq, worst_ineq) < o.tolerance and change < o.optimality:
            break
        if not merit < NO_NUMBER:
            return cost, BEYOND, BEYOND, iterations
        for _ in range(int(o.inner)):
            iterations += 1
            accepted = False
            size = 0.0
            decrease = 0.0
            for _ in range(TRIES):
                if not _model_step(X, prefix, chain, mult, model, damping, bandwidth, A, b, gradient, step):
                    damping = max(damping * 10.0, 1e-4)
                    continue
                size = 0.0
                slope = 0.0
                for k in range(N):
                    size = max(size, abs(step[k]))
                    slope += gradient[k] * step[k]
                scale = 1.0 if size < o.max_step else o.max_step / size
                slope *= scale
                size *= scale
                for t in range(T):
                    for i in range(n):
                        Xn[t, i] = X[t, i] + scale * step[n * t + i]
                trial, trial_cost, trial_eq, trial_ineq, _ = _evaluate(
                    Xn, prefix, chain, terms, cols, samples, o, mult, trial_model, s, 0.0
                )
                won = merit - trial
                if won >= -LEAST_GAIN * slope - 1e-12:
                    accepted = True
                    if won < -POOR_GAIN * slope:
                        damping = max(damping * 3.0, 1e-2)
                    elif won > -GOOD_GAIN * slope:
                        damping = max(damping * 0.2, o.damping)
                    break
                damping = max(damping * 10.0, 1e-2)
                # where little can be won, rounding and the kinks of distances decide: no use in insisting
                if size < 1e-6 or -slope < o.gain_tolerance * abs(merit):
                    break
            if not accepted:
                break
            decrease = merit - trial
            X[:] = Xn
            merit, cost, worst_eq, worst_ineq = trial, trial_cost, trial_eq, trial_ineq
            model, trial_model = trial_model, model
            if size < o.step_tolerance or decrease < o.gain_tolerance * abs(merit):
                break
        worst = max(worst_eq, worst_ineq)
        if (worst < o.tolerance and o.optimality >= NEVER) or iterations >= o.iterations:
            break
        old = mult.mu[0]
        if worst > ENOUGH * before:
            mult.mu[0] = min(mult.mu[0] * o.mu_growth, o.mu_max)
        stalled = stalled + 1 if worst > STALL * before else 0
        if stalled == STALLS:
            break
        before = worst
    return cost, worst_eq, worst_ineq, iterations


@nb.njit(**OPTIONS)
def solve(X, prefix, chain, terms, cols, samples, o):
    """:func:`solve_from` with nothing known of the multipliers."""
    T, n = X.shape
    mult = new_multipliers(T, n, terms, cols, samples, o.mu)
    s = new_scratch(T, n, chain, terms, cols, samples, prefix)
    return solve_from(X, prefix, chain, terms, cols, samples, o, mult, s)


@nb.njit(**OPTIONS)
def _solve_posture(X, prefix, chain, terms, cols, samples, o):
    """Solves a one-step problem in place, X (1, n): roughly without collisions; if that works, from there with them.

    Returns the worst violation; BEYOND where not even the first works.
    """
    n = X.shape[1]
    rough = Options(
        o.mu, o.mu_growth, o.mu_max, max(ROUGH, o.tolerance), o.outer, o.inner, o.iterations, o.max_step, o.damping,
        o.step_tolerance, o.gain_tolerance, o.acceleration, o.velocity, o.detection_distance, o.optimality,
    )  # fmt: skip
    free = Samples(samples.first, samples.alpha, np.zeros_like(samples.mask))
    mult = new_multipliers(1, n, terms, cols, samples, o.mu)
    s = new_scratch(1, n, chain, terms, cols, samples, prefix)
    _, eq, ineq, _ = solve_from(X, prefix, chain, terms, cols, free, rough, mult, s)
    if not max(eq, ineq) < rough.tolerance:
        return BEYOND
    s.known[:] = False
    s.wake[:] = 0.0
    _, eq, ineq, _ = solve_from(X, prefix, chain, terms, cols, samples, o, mult, s)
    return max(eq, ineq)


@nb.njit(**OPTIONS)
def solve_batch(X, prefix, chain, terms, params, cols, samples, o):
    """Solves K problems of one structure and one step that differ in start and parameters, in place.

    Each is first solved roughly without collisions; only those that then come near their target are solved with them,
    from there.

    Args:
        X: (K, 1, n); prefix: (K, 2, n); params: (K, N) replaces terms.params for each problem.

    Returns:
        worst violation (K,).
    """
    result = np.empty(X.shape[0])
    for k in range(X.shape[0]):
        own = _with_params(terms, params[k])
        result[k] = _solve_posture(X[k], prefix[k], chain, own, cols, samples, o)
    return result


@nb.njit(**OPTIONS)
def solve_until(starts, near, chain, terms, params, cols, samples, o):
    """Solves a one-step problem from one start (n,) after the other of ``starts`` (K, n), until one is feasible.

    Args:
        near: (K, n) configurations to stay near; params: as for :func:`solve_batch`.

    Returns:
        (q (n,), worst violation): those of the first that is feasible, else of the least violated.
    """
    K, n = starts.shape
    own = _with_params(terms, params)
    prefix, X, best = np.empty((2, n)), np.empty((1, n)), np.empty(n)
    least = 2.0 * BEYOND
    for k in range(K):
        for i in range(n):
            X[0, i] = starts[k, i]
            prefix[0, i] = prefix[1, i] = near[k, i]
        worst = _solve_posture(X, prefix, chain, own, cols, samples, o)
        if worst < least or k == 0:
            least = worst
            best[:] = X[0]
        if least <= o.tolerance:
            break
    return best, least


@nb.njit(**OPTIONS)
def solve_ends(start, last, random, elsewhere, chain, terms, cols, samples, o):
    """Configurations for the last steps of the phases of a path, one after the other, each near the one before.

    Args:
        start: (n,) configuration before the path.
        last: (K,) last step of each phase.
        random: (K, R, n) configurations from which the end of a phase is sought too.
        elsewhere: the first end that is asked for comes from the random ones alone, and stays near them.
        terms, samples: of the path.

    Returns:
        (Q (K, n): the first that is feasible, else the least violated; asked (K,): whether an equality is asked).
    """
    K, R, n = random.shape
    Q, asked = np.empty((K, n)), np.zeros(K, np.bool_)
    before = start
    for k in range(K):
        sample = samples.first[last[k] + 1] - 1
        own, asked[k] = _asked(terms, sample)
        if not asked[k]:
            continue
        only = Samples(np.array([0, 1]), np.ones(1), samples.mask[sample : sample + 1])
        starts, near = np.empty((R + 1, n)), np.empty((R + 1, n))
        starts[0] = before
        starts[1:] = random[k]
        near[:] = before
        if elsewhere and k == 0:
            # what follows stays on its branch of the arm, or carrying could not connect the two
            Q[k] = solve_until(random[k], random[k], chain, own, own.params, cols, only, o)[0]
        else:
            Q[k] = solve_until(starts, near, chain, own, own.params, cols, only, o)[0]
        before = Q[k]
    return Q, asked


@nb.njit(**OPTIONS)
def _asked(terms, sample):
    """The constraints of order 0 of a sample as those of a problem of one step, and whether one is an equality."""
    begin, end = terms.by_sample[sample], terms.by_sample[sample + 1]
    chosen = np.empty(end - begin, np.int64)
    count = 0
    equality = False
    for m in range(begin, end):
        if terms.order[m] == 0 and terms.type[m] != SOS:
            chosen[count] = m
            count += 1
            equality = equality or terms.type[m] == EQ
    c = chosen[:count]
    return Terms(
        terms.kernel[c], terms.type[c], np.zeros(count, np.int64), terms.dim[c], terms.scale[c], terms.frames[c],
        terms.offset[c], terms.params, terms.target[c], terms.order[c], terms.band[c], np.array([0, count]),
        terms.objective[c], terms.tau,
    ), equality  # fmt: skip


@nb.njit(**OPTIONS)
def _with_params(terms, params):
    return Terms(
        terms.kernel, terms.type, terms.step, terms.dim, terms.scale, terms.frames, terms.offset, params, terms.target,
        terms.order, terms.band, terms.by_sample, terms.objective, terms.tau,
    )  # fmt: skip


@nb.njit(**OPTIONS)
def follow(q, chain, terms, params, cols, samples, o, max_jump):
    """Solves one-step problems one after the other, each from the last one's solution; stops where one fails.

    Args:
        q: (n,) configuration before the first.
        chain, terms, cols, samples, o: as for :func:`solve_batch`.
        params: (M, N) parameters of each problem.
        max_jump: no joint may move by more than this between two solutions, rad or m.

    Returns:
        (Q (M, n), count): the solutions, of which the first ``count`` are valid.
    """
    M = params.shape[0]
    n = q.shape[0]
    Q = np.empty((M, n))
    X = np.empty((1, n))
    prefix = np.empty((2, n))
    before = q.copy()
    for m in range(M):
        prefix[0] = before
        prefix[1] = before
        X[0] = before
        if m > 1:
            X[0] = 2.0 * before - Q[m - 2]  # go on as so far
        _, eq, ineq, _ = solve(X, prefix, chain, _with_params(terms, params[m]), cols, samples, o)
        if not max(eq, ineq) <= o.tolerance:
            return Q, m
        if m > 0:
            for i in range(n):
                if abs(X[0, i] - before[i]) > max_jump:
                    return Q, m
        Q[m] = X[0]
        before = Q[m].copy()
    return Q, M


@nb.njit(**OPTIONS)
def linearise(X, prefix, chain, terms, cols, samples):
    """Values (M, MAX_DIM) of all terms less targets, and their Jacobians (M, MAX_DIM, 3 n) by x_t, x_(t-1), x_(t-2)."""
    T, n = X.shape
    M = terms.kernel.shape[0]
    s = new_scratch(T, n, chain, terms, cols, samples, prefix)
    R, p = np.zeros((T + MAX_ORDER, n + 1, 3, 3)), np.zeros((T + MAX_ORDER, n + 1, 3))
    for t in range(T + MAX_ORDER):
        q = X[t - MAX_ORDER] if t >= MAX_ORDER else prefix[t]
        forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[t], p[t])
    s = Scratch(
        R, p, s.Rm, s.pm, s.Hs, s.gs, s.witness, s.work, s.r, s.rk, s.J, s.Jk, s.qs, s.seen, s.travel, s.wake,
        s.known, s.centers, s.turned, s.slack, s.guesses, s.moved,
    )  # fmt: skip
    values, jacobians = np.zeros((M, MAX_DIM)), np.zeros((M, MAX_DIM, 3 * n))
    for m in range(M):
        t = terms.step[m]
        _value(X, prefix, t, m, chain, terms, s)
        for d in range(terms.dim[m]):
            values[m, d] = s.r[d]
            for k in range(min(terms.order[m], t) + 1):
                for i in range(n):
                    jacobians[m, d, n * k + i] = s.Jk[k, d, i]
    return values, jacobians


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
def standing_margins(q, mask, chain, cols, extra):
    """Margins (P,) of the pairs, where the configuration q (n,) has less lowered to what it has, less ``extra`` (m)."""
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
