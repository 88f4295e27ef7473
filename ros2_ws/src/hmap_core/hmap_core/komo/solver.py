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

from hmap_core.collision.gjk import OPTIONS
from hmap_core.collision.pairs import BEYOND, pair_distance, place_centers
from hmap_core.kinematics.tree import forward, point_jacobian
from hmap_core.komo.arrays import Multipliers, Scratch, Terms
from hmap_core.komo.banded import PADDING, cholesky_solve
from hmap_core.komo.features.base import MAX_DIM, call_kernel

SOS, EQ, INEQ = 0, 1, 2
MAX_ORDER = 2
NO_NUMBER = 1e300  # a merit that is not below this is no number: some target or parameter is none
LOOK_AHEAD = 0.05  # m beyond its margin to which a pair's distance is found, so that it can be left alone for a while
NEVER = BEYOND * BEYOND  # in Scratch.until: a travel that is not reached


@nb.njit(**OPTIONS)
def new_multipliers(T, n, terms, cols, samples, mu):
    """Multipliers to begin with: none is felt yet."""
    return Multipliers(
        np.zeros((terms.kernel.shape[0], MAX_DIM)), np.zeros((samples.alpha.shape[0], cols.a.shape[0])),
        np.zeros((T, n, 2)), np.full(1, mu),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def new_scratch(T, n, chain, terms, cols, samples, prefix):
    """Scratch for a problem of T steps; pairs that a sample's phases do not ask for are never looked at."""
    P, S = cols.a.shape[0], samples.alpha.shape[0]
    order = 0
    for m in range(terms.order.shape[0]):
        order = max(order, terms.order[m])
    kept = T + MAX_ORDER if order > 0 else 1
    R, p = np.zeros((kept, n + 1, 3, 3)), np.zeros((kept, n + 1, 3))
    if order > 0:
        for k in range(MAX_ORDER):
            forward(prefix[k], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[k], p[k])
    until, hints = np.empty((S, P)), np.empty((S, P, 9), np.int16)
    for sample in range(S):
        for k in range(P):
            until[sample, k] = 0.0 if cols.phases[k] & samples.mask[sample] else NEVER
            hints[sample, k, 0] = 0
    return Scratch(
        R, p, np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n, n)), np.zeros(n), np.zeros(n),
        np.zeros((cols.frame.shape[0], 3)), hints, np.zeros((3, 3)), np.zeros((20, 3)),
        np.zeros(MAX_DIM), np.zeros(MAX_DIM), np.zeros((MAX_DIM, n)), np.zeros((MAX_ORDER + 1, MAX_DIM, n)),
        np.zeros(n), np.zeros(S), np.zeros((S, n)), until, np.zeros(S),
    )  # fmt: skip


@nb.njit(**OPTIONS)
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


@nb.njit(**OPTIONS)
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


@nb.njit(**OPTIONS)
def _collide(cols, chain, s, sample, R, p, mu, lam, activity, update):
    """Looks at the pairs of one sample with the frames (R, p).

    Adds the collision terms to s.Hs, s.gs, or, with ``update``, the violations to the multipliers lam (P,).
    Returns (penalty, worst violation).
    """
    n = s.gs.shape[0]
    place_centers(cols, R, p, s.centers)
    centers, until, hints, witness, row = s.centers, s.until[sample], s.hints[sample], s.witness, s.row
    A, B, margin, bound, closing = cols.a, cols.b, cols.margin, cols.bound, cols.closing
    travel = s.travel[sample]
    penalty = 0.0
    worst = -BEYOND
    wake = NEVER
    for k in range(A.shape[0]):
        u = until[k]
        if travel < u:
            wake = min(wake, u)
            continue
        pulls = lam[k] > 0.0
        a, b = A[k], B[k]
        if not pulls:
            d0 = centers[a, 0] - centers[b, 0]
            d1 = centers[a, 1] - centers[b, 1]
            d2 = centers[a, 2] - centers[b, 2]
            gap = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) - bound[a] - bound[b] - margin[k]
            if gap > activity:
                until[k] = travel + gap / closing[k]
                wake = min(wake, until[k])
                continue
        cutoff = BEYOND if pulls else margin[k] + activity
        d = pair_distance(cols, k, R, p, centers, cutoff, hints[k], witness, s.work)
        c = margin[k] - d
        worst = max(worst, c)
        if update:
            lam[k] = max(0.0, lam[k] + mu * c)
            pulls = lam[k] > 0.0
        until[k] = 0.0 if pulls else max(0.0, travel - c / closing[k])
        wake = min(wake, until[k])
        shifted = c + lam[k] / mu
        if update or shifted <= 0.0:
            continue
        penalty += 0.5 * mu * shifted * shifted
        row[:] = 0.0
        w = witness
        fa, fb = cols.frame[a], cols.frame[b]
        first, prismatic = chain.first, chain.prismatic
        point_jacobian(R, p, first, prismatic, fa, w[1, 0], w[1, 1], w[1, 2], w[0, 0], w[0, 1], w[0, 2], -1.0, row)
        point_jacobian(R, p, first, prismatic, fb, w[2, 0], w[2, 1], w[2, 2], w[0, 0], w[0, 1], w[0, 2], 1.0, row)
        for i in range(n):
            if row[i] != 0.0:
                m = mu * row[i]
                s.gs[i] += m * shifted
                for j in range(i + 1):
                    s.Hs[i, j] += m * row[j]
    s.wake[sample] = wake
    return penalty, worst


@nb.njit(**OPTIONS)
def _call(terms, m, n, chain, s, index, q, r, J):
    """Value r and Jacobian J of term m at the configuration q, whose frames are s.R[index], s.p[index]."""
    J[: terms.dim[m]] = 0.0
    call_kernel(
        terms.kernel[m], n, s.R[index].ctypes.data, s.p[index].ctypes.data, chain.first.ctypes.data,
        chain.prismatic.ctypes.data, q.ctypes.data, terms.frames[m].ctypes.data,
        terms.params[terms.offset[m] :].ctypes.data, r.ctypes.data, J.ctypes.data,
    )  # fmt: skip


@nb.njit(**OPTIONS)
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
        _call(terms, m, n, chain, s, step + MAX_ORDER, q, s.rk, s.Jk[k])
        for d in range(dim):
            s.r[d] += weight * s.rk[d]
            for i in range(n):
                s.Jk[k, d, i] *= weight
        weight *= -(order - k) / (k + 1)
    for d in range(dim):
        s.r[d] -= terms.target[m, d]


@nb.njit(**OPTIONS)
def _pull(value, kind, scale, mu, lam):
    """(weight, shifted value) of a component in the augmented Lagrangian; weight 0 where it is not felt."""
    if kind == SOS:
        return scale, value
    weight = mu * scale
    shifted = value + lam / weight
    if kind == INEQ and shifted <= 0.0:
        return 0.0, 0.0
    return weight, shifted


@nb.njit(**OPTIONS)
def _objectives(X, prefix, t, chain, terms, mu, lam, s, H, G):
    """Adds the objectives of step t: to s.Hs, s.gs, those that look at several steps to H, G.

    Returns (merit, cost, worst equality, worst inequality).
    """
    n = X.shape[1]
    merit = 0.0
    cost = 0.0
    worst_eq = 0.0
    worst_ineq = -BEYOND
    for m in range(terms.by_step[t], terms.by_step[t + 1]):
        dim, kind, order = terms.dim[m], terms.type[m], terms.order[m]
        if order == 0:
            _call(terms, m, n, chain, s, t + MAX_ORDER if s.R.shape[0] > 1 else 0, X[t], s.r, s.J)
            for d in range(dim):
                s.r[d] -= terms.target[m, d]
        else:
            _value(X, prefix, t, m, chain, terms, s)
        for d in range(dim):
            if kind == EQ:
                worst_eq = max(worst_eq, abs(s.r[d]))
            elif kind == INEQ:
                worst_ineq = max(worst_ineq, s.r[d])
            weight, value = _pull(s.r[d], kind, terms.scale[m], mu, lam[m, d])
            if weight == 0.0:
                continue
            half = 0.5 * weight * value * value
            merit += half
            if kind == SOS:
                cost += half
            if order == 0:
                for i in range(n):
                    g = weight * s.J[d, i]
                    if g != 0.0:
                        s.gs[i] += g * value
                        for j in range(i + 1):
                            s.Hs[i, j] += g * s.J[d, j]
                continue
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
    return merit, cost, worst_eq, worst_ineq


@nb.njit(**OPTIONS)
def _evaluate(X, prefix, chain, terms, cols, samples, o, mult, H, G, s):
    """Augmented Lagrangian at X with gradient G (T n,) and Gauss-Newton Hessian H (T n, 3 n + PADDING).

    Returns (merit, cost, worst equality, worst inequality); worst values are unscaled, in metres and radians.
    """
    T, n = X.shape
    mu = mult.mu[0]
    H[:] = 0.0
    G[:] = 0.0
    cost = _smoothness(X, prefix, o.acceleration, o.velocity, H, G)
    merit = cost
    worst_eq = 0.0
    worst_ineq = -BEYOND
    parent, R_joint, p_joint, prismatic = chain.parent, chain.R_joint, chain.p_joint, chain.prismatic
    lower, upper, reach, limits = chain.lower, chain.upper, chain.reach, mult.limits
    first, alphas, by_step = samples.first, samples.alpha, terms.by_step
    qs, seen, travel, wake, Hs, gs = s.qs, s.seen, s.travel, s.wake, s.Hs, s.gs
    several = s.R.shape[0] > 1
    for t in range(T):
        for sample in range(first[t], first[t + 1]):
            alpha = alphas[sample]
            step = sample + 1 == first[t + 1]
            moved = _visit(X, prefix, t, alpha, reach, sample, qs, seen, travel)
            asks = step and (several or by_step[t] < by_step[t + 1])
            awake = moved >= wake[sample]
            if not (asks or awake):
                continue
            R, p = (s.R[t + MAX_ORDER if several else 0], s.p[t + MAX_ORDER if several else 0]) if step else (s.Rm, s.pm)
            forward(qs, parent, R_joint, p_joint, prismatic, R, p)
            Hs[:] = 0.0
            gs[:] = 0.0
            if awake:
                penalty, worst = _collide(cols, chain, s, sample, R, p, mu, mult.pairs[sample], o.activity, False)
                merit += penalty
                worst_ineq = max(worst_ineq, worst)
                if penalty == 0.0 and not asks:
                    continue
            if asks:
                m, c, we, wi = _objectives(X, prefix, t, chain, terms, mu, mult.terms, s, H, G)
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
            x = X[t, i]
            c = lower[i] - x
            sign = -1.0
            side = 0
            if x - upper[i] > c:
                c = x - upper[i]
                sign = 1.0
                side = 1
            worst_ineq = max(worst_ineq, c)
            shifted = c + limits[t, i, side] / mu
            if shifted > 0.0:
                merit += 0.5 * mu * shifted * shifted
                G[n * t + i] += mu * shifted * sign
                H[n * t + i, 0] += mu
    return merit, cost, worst_eq, worst_ineq


@nb.njit(**OPTIONS)
def _update_multipliers(X, prefix, chain, terms, cols, samples, o, mult, s):
    T, n = X.shape
    mu = mult.mu[0]
    several = s.R.shape[0] > 1
    for t in range(T):
        for sample in range(samples.first[t], samples.first[t + 1]):
            step = sample + 1 == samples.first[t + 1]
            moved = _visit(X, prefix, t, samples.alpha[sample], chain.reach, sample, s.qs, s.seen, s.travel)
            asks = step and (several or terms.by_step[t] < terms.by_step[t + 1])
            awake = moved >= s.wake[sample]
            if not (asks or awake):
                continue
            index = (t + MAX_ORDER if several else 0) if step else 0
            R, p = (s.R[index], s.p[index]) if step else (s.Rm, s.pm)
            forward(s.qs, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
            if awake:
                _collide(cols, chain, s, sample, R, p, mu, mult.pairs[sample], o.activity, True)
        for m in range(terms.by_step[t], terms.by_step[t + 1]):
            if terms.type[m] == SOS:
                continue
            if terms.order[m] == 0:
                _call(terms, m, n, chain, s, t + MAX_ORDER if several else 0, X[t], s.r, s.J)
                for d in range(terms.dim[m]):
                    s.r[d] -= terms.target[m, d]
            else:
                _value(X, prefix, t, m, chain, terms, s)
            for d in range(terms.dim[m]):
                lam = mult.terms[m, d] + mu * terms.scale[m] * s.r[d]
                mult.terms[m, d] = lam if terms.type[m] == EQ else max(0.0, lam)
        for i in range(n):
            mult.limits[t, i, 0] = max(0.0, mult.limits[t, i, 0] + mu * (chain.lower[i] - X[t, i]))
            mult.limits[t, i, 1] = max(0.0, mult.limits[t, i, 1] + mu * (X[t, i] - chain.upper[i]))


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
    H, Hn, A = np.zeros((N, band + PADDING)), np.zeros((N, band + PADDING)), np.zeros((N, band + PADDING))
    G, Gn, b = np.zeros(N), np.zeros(N), np.zeros(N)
    Xn = np.zeros((T, n))
    bandwidth = min(band - 1, N - 1)
    damping = o.damping
    iterations = 0
    cost = 0.0
    worst_eq = BEYOND
    worst_ineq = BEYOND
    for _outer in range(int(o.outer)):
        merit, cost, worst_eq, worst_ineq = _evaluate(X, prefix, chain, terms, cols, samples, o, mult, H, G, s)
        if not merit < NO_NUMBER:
            return cost, BEYOND, BEYOND, iterations
        for _ in range(int(o.inner)):
            iterations += 1
            accepted = False
            step = 0.0
            decrease = 0.0
            for _ in range(10):
                A[:] = H
                for i in range(N):
                    A[i, 0] += damping
                    b[i] = -G[i]
                if not cholesky_solve(A, b, bandwidth):
                    damping = max(damping * 10.0, 1e-4)
                    continue
                step = 0.0
                slope = 0.0
                for i in range(N):
                    step = max(step, abs(b[i]))
                    slope += G[i] * b[i]
                scale = 1.0 if step < o.max_step else o.max_step / step
                slope *= scale
                step *= scale
                for t in range(T):
                    for i in range(n):
                        Xn[t, i] = X[t, i] + scale * b[n * t + i]
                trial, trial_cost, trial_eq, trial_ineq = _evaluate(
                    Xn, prefix, chain, terms, cols, samples, o, mult, Hn, Gn, s
                )
                if trial <= merit + 0.01 * slope + 1e-12:
                    accepted = True
                    damping = max(damping * 0.2, o.damping)
                    break
                damping = max(damping * 10.0, 1e-2)
                if step < 1e-6:
                    break
            if not accepted:
                break
            decrease = merit - trial
            X[:] = Xn
            merit, cost, worst_eq, worst_ineq = trial, trial_cost, trial_eq, trial_ineq
            H, Hn = Hn, H
            G, Gn = Gn, G
            if step < o.step_tolerance or decrease < o.gain_tolerance * abs(merit):
                break
        if max(worst_eq, worst_ineq) < o.tolerance or iterations >= o.iterations:
            break
        _update_multipliers(X, prefix, chain, terms, cols, samples, o, mult, s)
        mult.mu[0] = min(mult.mu[0] * o.mu_growth, o.mu_max)
    return cost, worst_eq, worst_ineq, iterations


@nb.njit(**OPTIONS)
def solve(X, prefix, chain, terms, cols, samples, o):
    """:func:`solve_from` with nothing known of the multipliers."""
    T, n = X.shape
    mult = new_multipliers(T, n, terms, cols, samples, o.mu)
    s = new_scratch(T, n, chain, terms, cols, samples, prefix)
    return solve_from(X, prefix, chain, terms, cols, samples, o, mult, s)


@nb.njit(**OPTIONS)
def solve_batch(X, prefix, chain, terms, params, cols, free, samples, o):
    """Solves K problems of one structure that differ in start and parameters, in place.

    Each is first solved without collisions; only those that then reach their target are solved with them, from there.

    Args:
        X: (K, T, n); prefix: (K, 2, n); params: (K, N) replaces terms.params for each problem.
        free: the collision model without its pairs.

    Returns:
        worst equality and inequality (K, 2).
    """
    result = np.empty((X.shape[0], 2))
    for k in range(X.shape[0]):
        own = _with_params(terms, params[k])
        _, eq, ineq, _ = solve(X[k], prefix[k], chain, own, free, samples, o)
        if max(eq, ineq) < o.tolerance and cols.a.shape[0] > 0:
            _, eq, ineq, _ = solve(X[k], prefix[k], chain, own, cols, samples, o)
        result[k, 0] = eq
        result[k, 1] = ineq
    return result


@nb.njit(**OPTIONS)
def _with_params(terms, params):
    return Terms(
        terms.kernel, terms.type, terms.step, terms.dim, terms.scale, terms.frames, terms.offset, params, terms.target,
        terms.order, terms.by_step, terms.tau,
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
    """Values (M, MAX_DIM) of all terms less their targets, and their Jacobians (M, MAX_DIM, 3 n) by x_t, x_(t-1), x_(t-2)."""
    T, n = X.shape
    M = terms.kernel.shape[0]
    s = new_scratch(T, n, chain, terms, cols, samples, prefix)
    R, p = np.zeros((T + MAX_ORDER, n + 1, 3, 3)), np.zeros((T + MAX_ORDER, n + 1, 3))
    for t in range(T + MAX_ORDER):
        q = X[t - MAX_ORDER] if t >= MAX_ORDER else prefix[t]
        forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[t], p[t])
    s = Scratch(
        R, p, s.Rm, s.pm, s.Hs, s.gs, s.row, s.centers, s.hints, s.witness, s.work, s.r, s.rk, s.J, s.Jk, s.qs,
        s.travel, s.seen, s.until, s.wake,
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


@nb.njit(**OPTIONS)
def _look(R, p, mask, cols, floor, travel, until, hints, centers, witness, work):
    """Pairs at one configuration: (worst violation, its pair or -1 where none > floor, travel to the next look)."""
    place_centers(cols, R, p, centers)
    violation = floor
    pair = -1
    following = NEVER
    for k in range(cols.a.shape[0]):
        if cols.phases[k] & mask == 0:
            continue
        if travel >= until[k]:
            margin = cols.margin[k]
            d = pair_distance(cols, k, R, p, centers, margin + LOOK_AHEAD, hints[k], witness, work)
            until[k] = travel + (d - margin + floor) / cols.closing[k]
            if margin - d > violation:
                violation = margin - d
                pair = k
        following = min(following, until[k])
    return violation, pair, following


@nb.njit(**OPTIONS)
def path_violations(path, masks, chain, cols, floor):
    """Worst margin violation of each configuration.

    Args:
        path: (M, n); masks: (M,) bit mask of phases of each.
        floor: violations below this are not looked for, m.

    Returns:
        (violation (M,) in metres, positive where a pair is closer than its margin; pair (M,), -1 where none > floor).
    """
    M, n = path.shape
    P = cols.a.shape[0]
    violation, pair = np.full(M, floor), np.full(M, -1, np.int64)
    R, p, centers = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((cols.frame.shape[0], 3))
    hints, until, witness, work = np.zeros((P, 9), np.int16), np.zeros(P), np.zeros((3, 3)), np.zeros((20, 3))
    travel = 0.0
    for m in range(M):
        if m > 0:
            for i in range(n):
                travel += chain.reach[i] * abs(path[m, i] - path[m - 1, i])
        forward(path[m], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        violation[m], pair[m], _ = _look(
            R, p, masks[m], cols, floor, travel, until, hints, centers, witness, work
        )
    return violation, pair


@nb.njit(**OPTIONS)
def between_violations(path, masks, chain, cols, resolution):
    """Worst margin violation within each interval of a path that is straight between its configurations.

    The next place to look at is as far as the distances found allow (conservative advancement [3]), at least
    ``resolution`` metres of motion further.

    [3] Mirtich, Impulse-based dynamic simulation, 1996.

    Args:
        path: (T + 1, n); masks: (T,) bit mask of the phases of each interval.

    Returns:
        (violation (T,) in metres, 0 where there is none; pair (T,) or -1; alpha (T,): where in the interval).
    """
    T, n = path.shape[0] - 1, path.shape[1]
    P = cols.a.shape[0]
    violation, pair, where = np.zeros(T), np.full(T, -1, np.int64), np.zeros(T)
    R, p, centers = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((cols.frame.shape[0], 3))
    hints, until, witness, work = np.zeros((P, 9), np.int16), np.zeros(P), np.zeros((3, 3)), np.zeros((20, 3))
    q = np.empty(n)
    travel = 0.0
    following = 0.0  # travel at which some pair has to be looked at again
    mask = 0
    for t in range(T):
        rate = 0.0
        for i in range(n):
            rate += chain.reach[i] * abs(path[t + 1, i] - path[t, i])
        if masks[t] != mask:
            mask = masks[t]
            following = travel
        start = travel
        while following <= start + rate:
            at = max(following, travel)
            alpha = (at - start) / rate if rate > 0.0 else 1.0
            travel = at
            for i in range(n):
                q[i] = (1.0 - alpha) * path[t, i] + alpha * path[t + 1, i]
            forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
            worst, k, following = _look(R, p, mask, cols, 0.0, travel, until, hints, centers, witness, work)
            if worst > violation[t]:
                violation[t], pair[t], where[t] = worst, k, alpha
            following = max(following, travel + resolution)
        travel = start + rate
    return violation, pair, where


@nb.njit(**OPTIONS)
def standing_margins(q, mask, chain, cols, extra):
    """Margins (P,) of the pairs, lowered to what the configuration q (n,) has, less ``extra`` (m), where that is less."""
    n = q.shape[0]
    R, p, centers = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((cols.frame.shape[0], 3))
    hint, witness, work = np.zeros(9, np.int16), np.zeros((3, 3)), np.zeros((20, 3))
    forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
    place_centers(cols, R, p, centers)
    margin = cols.margin.copy()
    for k in range(margin.shape[0]):
        if cols.phases[k] & mask:
            hint[0] = 0
            d = pair_distance(cols, k, R, p, centers, margin[k], hint, witness, work)
            if d < margin[k]:
                margin[k] = d - extra
    return margin
