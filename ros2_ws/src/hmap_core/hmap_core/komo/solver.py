"""Augmented-Lagrangian Gauss-Newton on the banded structure of a path problem (KOMO [1, 2]), compiled.

The path x (T, n) minimises weighted squared velocities and accelerations plus the sos objectives, subject to eq and
ineq objectives at their steps, joint limits at every step, and the collision pairs at every step *and* between the
steps (``substeps`` samples per interval, on the straight line between two configurations). Every constraint component
has its own multiplier; convergence asks the worst component, in metres and radians, never a sum.

[1] Toussaint, A tutorial on Newton methods for constrained trajectory optimization, 2017.
[2] Nocedal and Wright, Numerical Optimization, 2006, ch. 17.4.
"""

import numba as nb
import numpy as np

from hmap_core.collision.gjk import OPTIONS
from hmap_core.collision.pairs import BEYOND, pair_distance, place_centers
from hmap_core.kinematics.tree import forward, point_jacobian
from hmap_core.komo.arrays import Scratch, Terms
from hmap_core.komo.banded import cholesky_solve
from hmap_core.komo.features.base import MAX_DIM, call_kernel

SOS, EQ, INEQ = 0, 1, 2
NO_NUMBER = 1e300  # a merit that is not below this is no number: some target or parameter is none
LOOK_AHEAD = 0.05  # m beyond its margin to which a pair's distance is found, so that it can be left alone for a while


@nb.njit(**OPTIONS)
def _scratch(T, n, cols, substeps):
    P = cols.a.shape[0]
    return Scratch(
        np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n, n)), np.zeros(n), np.zeros(n),
        np.zeros((cols.frame.shape[0], 3)), np.zeros((T * substeps, P, 3)), np.zeros((3, 3)), np.zeros((20, 3)),
        np.zeros(MAX_DIM), np.zeros((MAX_DIM, n)), np.zeros(n),
        np.zeros(T * substeps), np.zeros((T * substeps, n)), np.zeros((T * substeps, P)),
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
                H[k, n] -= 2 * w_acc + w_vel
            if t >= 2:
                G[k - 2 * n] += w_acc * a
                H[k - 2 * n, 0] += w_acc
                H[k - n, n] -= 2 * w_acc
                H[k, 2 * n] += w_acc
    return cost


@nb.njit(**OPTIONS)
def _place(sample, chain, cols, s):
    """Frames and bounding spheres at the configuration in s.qs, and how far anything may have moved since last time."""
    forward(s.qs, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, s.R, s.p)
    place_centers(cols, s.R, s.p, s.centers)
    moved = 0.0
    for i in range(s.qs.shape[0]):
        moved += chain.reach[i] * abs(s.qs[i] - s.seen[sample, i])
        s.seen[sample, i] = s.qs[i]
    s.travel[sample] += moved


@nb.njit(**OPTIONS)
def _closing(cols, k):
    """How much nearer the shapes of pair k may come per metre of travel."""
    return max(1e-6, cols.speed[cols.a[k]] + cols.speed[cols.b[k]])


@nb.njit(**OPTIONS)
def _distance(cols, k, sample, lam, activity, s):
    """Signed distance of pair k at a sample, or a bound where it is not needed exactly."""
    cutoff = cols.margin[k] + (BEYOND if lam > 0.0 else activity)
    d = pair_distance(cols, k, s.R, s.p, s.centers, cutoff, s.axes[sample, k], s.witness, s.work)
    s.until[sample, k] = s.travel[sample] + (d - cols.margin[k] - activity) / _closing(cols, k)
    return d


@nb.njit(**OPTIONS)
def _collide(cols, chain, phases, mu, lam, sample, s, activity):
    """Adds the collision terms at the frames in scratch to s.Hs, s.gs. Returns (penalty, worst violation)."""
    n = s.gs.shape[0]
    penalty = 0.0
    worst = -BEYOND
    for k in range(cols.a.shape[0]):
        if cols.phases[k] & phases == 0:
            continue
        if lam[k] <= 0.0:
            # checked here, not in _distance: calls that pass named tuples cost more than these tests save
            if s.travel[sample] < s.until[sample, k]:
                continue
            a, b = cols.a[k], cols.b[k]
            d0 = s.centers[a, 0] - s.centers[b, 0]
            d1 = s.centers[a, 1] - s.centers[b, 1]
            d2 = s.centers[a, 2] - s.centers[b, 2]
            gap = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) - cols.bound[a] - cols.bound[b] - cols.margin[k] - activity
            if gap > 0.0:
                s.until[sample, k] = s.travel[sample] + gap / _closing(cols, k)
                continue
        d = _distance(cols, k, sample, lam[k], activity, s)
        c = cols.margin[k] - d
        if c > worst:
            worst = c
        shifted = c + lam[k] / mu
        if shifted <= 0.0:
            continue
        penalty += 0.5 * mu * shifted * shifted
        row = s.row
        row[:] = 0.0
        w = s.witness
        fa, fb = cols.frame[cols.a[k]], cols.frame[cols.b[k]]
        first, prismatic = chain.first, chain.prismatic
        point_jacobian(s.R, s.p, first, prismatic, fa, w[1, 0], w[1, 1], w[1, 2], w[0, 0], w[0, 1], w[0, 2], -1.0, row)
        point_jacobian(s.R, s.p, first, prismatic, fb, w[2, 0], w[2, 1], w[2, 2], w[0, 0], w[0, 1], w[0, 2], 1.0, row)
        for i in range(n):
            if row[i] != 0.0:
                m = mu * row[i]
                s.gs[i] += m * shifted
                for j in range(i + 1):
                    s.Hs[i, j] += m * row[j]
    return penalty, worst


@nb.njit(**OPTIONS)
def _objectives(X, t, chain, terms, mu, lam, s):
    """Adds the objectives of step t. Returns (merit, cost, worst equality, worst inequality)."""
    n = X.shape[1]
    merit = 0.0
    cost = 0.0
    worst_eq = 0.0
    worst_ineq = -BEYOND
    for m in range(terms.by_step[t], terms.by_step[t + 1]):
        dim = terms.dim[m]
        s.J[:dim] = 0.0
        call_kernel(
            terms.kernel[m], n, s.R.ctypes.data, s.p.ctypes.data, chain.first.ctypes.data, chain.prismatic.ctypes.data,
            X[t].ctypes.data, terms.frames[m].ctypes.data, terms.params[terms.offset[m] :].ctypes.data,
            s.r.ctypes.data, s.J.ctypes.data,
        )  # fmt: skip
        kind = terms.type[m]
        for d in range(dim):
            if kind == SOS:
                weight = terms.scale[m]
                value = s.r[d]
                cost += 0.5 * weight * value * value
                merit += 0.5 * weight * value * value
            else:
                weight = mu * terms.scale[m]
                if kind == EQ:
                    worst_eq = max(worst_eq, abs(s.r[d]))
                else:
                    worst_ineq = max(worst_ineq, s.r[d])
                value = s.r[d] + lam[m, d] / weight
                if kind == INEQ and value <= 0.0:
                    continue
                merit += 0.5 * weight * value * value
            for i in range(n):
                g = weight * s.J[d, i]
                if g != 0.0:
                    s.gs[i] += g * value
                    for j in range(i + 1):
                        s.Hs[i, j] += g * s.J[d, j]
    return merit, cost, worst_eq, worst_ineq


@nb.njit(**OPTIONS)
def _limits(X, t, chain, mu, lam, s):
    """Adds the joint limits of step t. Returns (penalty, worst violation)."""
    penalty = 0.0
    worst = -BEYOND
    for i in range(X.shape[1]):
        for side in range(2):
            sign = -1.0 if side == 0 else 1.0
            c = chain.lower[i] - X[t, i] if side == 0 else X[t, i] - chain.upper[i]
            worst = max(worst, c)
            shifted = c + lam[t, i, side] / mu
            if shifted > 0.0:
                penalty += 0.5 * mu * shifted * shifted
                s.gs[i] += mu * shifted * sign
                s.Hs[i, i] += mu
    return penalty, worst


@nb.njit(**OPTIONS)
def _interpolate(X, prefix, t, alpha, out):
    for i in range(X.shape[1]):
        before = X[t - 1, i] if t > 0 else prefix[1, i]
        out[i] = (1 - alpha) * before + alpha * X[t, i]


@nb.njit(**OPTIONS)
def _phases_at(phase, t):
    """Bit mask of the phases that step t belongs to; a step at a mode switch is in both."""
    mask = 1 << phase[t]
    if t + 1 < phase.shape[0]:
        mask |= 1 << phase[t + 1]
    return mask


@nb.njit(**OPTIONS)
def _evaluate(X, prefix, phase, chain, terms, cols, o, mu, lam_terms, lam_pairs, lam_limits, H, G, s):
    """Augmented Lagrangian at X with gradient G (T n,) and Gauss-Newton Hessian H (T n, 3 n).

    Returns (merit, cost, worst equality, worst inequality); worst values are unscaled, in metres and radians.
    """
    T, n = X.shape
    H[:] = 0.0
    G[:] = 0.0
    cost = _smoothness(X, prefix, o.acceleration, o.velocity, H, G)
    merit = cost
    worst_eq = 0.0
    worst_ineq = -BEYOND
    substeps = int(o.substeps)
    for t in range(T):
        for sub in range(1, substeps + 1):
            alpha = sub / substeps
            sample = t * substeps + sub - 1
            last = sub == substeps
            _interpolate(X, prefix, t, alpha, s.qs)
            _place(sample, chain, cols, s)
            s.Hs[:] = 0.0
            s.gs[:] = 0.0
            mask = _phases_at(phase, t) if last else 1 << phase[t]
            penalty, worst = _collide(cols, chain, mask, mu, lam_pairs[sample], sample, s, o.activity)
            merit += penalty
            worst_ineq = max(worst_ineq, worst)
            if last:
                m, c, we, wi = _objectives(X, t, chain, terms, mu, lam_terms, s)
                merit += m
                cost += c
                worst_eq = max(worst_eq, we)
                worst_ineq = max(worst_ineq, wi)
                penalty, worst = _limits(X, t, chain, mu, lam_limits, s)
                merit += penalty
                worst_ineq = max(worst_ineq, worst)
            elif penalty == 0.0:
                continue
            beta = 1.0 - alpha
            for i in range(n):
                k = n * t + i
                G[k] += alpha * s.gs[i]
                if t > 0:
                    G[k - n] += beta * s.gs[i]
                for j in range(i + 1):
                    H[k, i - j] += alpha * alpha * s.Hs[i, j]
                if t > 0 and beta > 0.0:
                    for j in range(n):
                        h = s.Hs[i, j] if j <= i else s.Hs[j, i]
                        H[k, n + i - j] += alpha * beta * h
                        if j <= i:
                            H[k - n, i - j] += beta * beta * h
    return merit, cost, worst_eq, worst_ineq


@nb.njit(**OPTIONS)
def _update_multipliers(X, prefix, phase, chain, terms, cols, o, mu, lam_terms, lam_pairs, lam_limits, s):
    T, n = X.shape
    substeps = int(o.substeps)
    for t in range(T):
        for sub in range(1, substeps + 1):
            sample = t * substeps + sub - 1
            _interpolate(X, prefix, t, sub / substeps, s.qs)
            _place(sample, chain, cols, s)
            mask = _phases_at(phase, t) if sub == substeps else 1 << phase[t]
            for k in range(cols.a.shape[0]):
                lam = lam_pairs[sample, k]
                if cols.phases[k] & mask == 0 or (lam <= 0.0 and s.travel[sample] < s.until[sample, k]):
                    continue
                d = _distance(cols, k, sample, lam, o.activity, s)
                lam_pairs[sample, k] = max(0.0, lam + mu * (cols.margin[k] - d))
        for m in range(terms.by_step[t], terms.by_step[t + 1]):
            if terms.type[m] == SOS:
                continue
            dim = terms.dim[m]
            s.J[:dim] = 0.0
            call_kernel(
                terms.kernel[m], n, s.R.ctypes.data, s.p.ctypes.data, chain.first.ctypes.data,
                chain.prismatic.ctypes.data, X[t].ctypes.data, terms.frames[m].ctypes.data,
                terms.params[terms.offset[m] :].ctypes.data, s.r.ctypes.data, s.J.ctypes.data,
            )  # fmt: skip
            for d in range(dim):
                lam = lam_terms[m, d] + mu * terms.scale[m] * s.r[d]
                lam_terms[m, d] = lam if terms.type[m] == EQ else max(0.0, lam)
        for i in range(n):
            lam_limits[t, i, 0] = max(0.0, lam_limits[t, i, 0] + mu * (chain.lower[i] - X[t, i]))
            lam_limits[t, i, 1] = max(0.0, lam_limits[t, i, 1] + mu * (X[t, i] - chain.upper[i]))


@nb.njit(**OPTIONS)
def solve(X, prefix, phase, chain, terms, cols, o):
    """Solves one problem in place, from X (T, n).

    Args:
        X: path (T, n), start and result.
        prefix: the two configurations (2, n) before the path.
        phase: (T,) phase of the interval that ends at each step.
        chain, terms, cols, o: see :mod:`hmap_core.komo.arrays` and :mod:`hmap_core.collision.scene_model`.

    Returns:
        (cost, worst equality, worst inequality, iterations).
    """
    T, n = X.shape
    N = T * n
    P = cols.a.shape[0]
    substeps = int(o.substeps)
    s = _scratch(T, n, cols, substeps)
    lam_terms = np.zeros((terms.kernel.shape[0], MAX_DIM))
    lam_pairs = np.zeros((T * substeps, P))
    lam_limits = np.zeros((T, n, 2))
    H, Hn, A = np.zeros((N, 3 * n)), np.zeros((N, 3 * n)), np.zeros((N, 3 * n))
    G, Gn, b = np.zeros(N), np.zeros(N), np.zeros(N)
    Xn = np.zeros((T, n))
    bandwidth = min(3 * n - 1, N - 1)
    mu = o.mu
    damping = o.damping
    iterations = 0
    cost = 0.0
    worst_eq = BEYOND
    worst_ineq = BEYOND
    for _outer in range(int(o.outer)):
        merit, cost, worst_eq, worst_ineq = _evaluate(
            X, prefix, phase, chain, terms, cols, o, mu, lam_terms, lam_pairs, lam_limits, H, G, s
        )
        if not merit < NO_NUMBER:
            return cost, BEYOND, BEYOND, iterations
        for _ in range(int(o.inner)):
            iterations += 1
            accepted = False
            step = 0.0
            decrease = 0.0
            for _ in range(10):
                for i in range(N):
                    for k in range(3 * n):
                        A[i, k] = H[i, k]
                    A[i, 0] += damping
                    b[i] = -G[i]
                if not cholesky_solve(A, b, bandwidth):
                    damping = max(damping * 10.0, 1e-4)
                    continue
                step = np.abs(b).max()
                scale = 1.0 if step < o.max_step else o.max_step / step
                slope = 0.0
                for i in range(N):
                    slope += scale * G[i] * b[i]
                for t in range(T):
                    for i in range(n):
                        Xn[t, i] = X[t, i] + scale * b[n * t + i]
                step *= scale
                trial, trial_cost, trial_eq, trial_ineq = _evaluate(
                    Xn, prefix, phase, chain, terms, cols, o, mu, lam_terms, lam_pairs, lam_limits, Hn, Gn, s
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
        _update_multipliers(X, prefix, phase, chain, terms, cols, o, mu, lam_terms, lam_pairs, lam_limits, s)
        mu = min(mu * o.mu_growth, o.mu_max)
    return cost, worst_eq, worst_ineq, iterations


@nb.njit(**OPTIONS)
def solve_batch(X, prefix, phase, chain, terms, params, cols, free, o):
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
        own = Terms(
            terms.kernel, terms.type, terms.step, terms.dim, terms.scale, terms.frames, terms.offset, params[k],
            terms.by_step,
        )  # fmt: skip
        _, eq, ineq, _ = solve(X[k], prefix[k], phase, chain, own, free, o)
        if max(eq, ineq) < o.tolerance and cols.a.shape[0] > 0:
            _, eq, ineq, _ = solve(X[k], prefix[k], phase, chain, own, cols, o)
        result[k, 0] = eq
        result[k, 1] = ineq
    return result


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
    s = _scratch(1, n, cols, 1)
    violation = np.full(M, floor)
    pair = np.full(M, -1, np.int64)
    for m in range(M):
        for i in range(n):
            s.qs[i] = path[m, i]
        _place(0, chain, cols, s)
        for k in range(cols.a.shape[0]):
            if cols.phases[k] & masks[m] == 0 or s.travel[0] < s.until[0, k]:
                continue
            cutoff = cols.margin[k] - violation[m]
            d = pair_distance(cols, k, s.R, s.p, s.centers, cutoff + LOOK_AHEAD, s.axes[0, k], s.witness, s.work)
            s.until[0, k] = s.travel[0] + (d - cols.margin[k] + floor) / _closing(cols, k)
            if cols.margin[k] - d > violation[m]:
                violation[m] = cols.margin[k] - d
                pair[m] = k
    return violation, pair


@nb.njit(**OPTIONS)
def follow(q, phase, chain, terms, params, cols, o, max_jump):
    """Solves one-step problems one after the other, each from the last one's solution; stops where one fails.

    Args:
        q: (n,) configuration before the first.
        phase: (1,); chain, terms, cols, o: as for :func:`solve_batch`.
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
        own = Terms(
            terms.kernel, terms.type, terms.step, terms.dim, terms.scale, terms.frames, terms.offset, params[m],
            terms.by_step,
        )  # fmt: skip
        prefix[0] = before
        prefix[1] = before
        X[0] = before
        if m > 1:
            X[0] = 2.0 * before - Q[m - 2]  # go on as so far
        _, eq, ineq, _ = solve(X, prefix, phase, chain, own, cols, o)
        if not max(eq, ineq) <= o.tolerance:
            return Q, m
        if m > 0:
            for i in range(n):
                if abs(X[0, i] - before[i]) > max_jump:
                    return Q, m
        Q[m] = X[0]
        before = Q[m].copy()
    return Q, M
