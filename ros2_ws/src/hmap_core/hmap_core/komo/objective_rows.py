"""The objectives in the model of a solve: their values and Jacobians, and what they add, compiled."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, OPTIONS, PLAIN
from hmap_core.collision.pairs import BEYOND
from hmap_core.kinematics.tree import forward
from hmap_core.komo.arrays import BAND, INEQ, SOS, Scratch
from hmap_core.komo.features.base import MAX_DIM, call_kernel
from hmap_core.komo.scratch import MAX_ORDER, new_scratch


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
def add_objectives(X, prefix, t, sample, alpha, R, p, chain, terms, mu, lam, s, model, old):
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
