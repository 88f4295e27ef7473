"""Problems of one step: in batches, from several starts, one after the other, and at the ends of phases; compiled."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.pairs import BEYOND
from hmap_core.komo.arrays import EQ, SOS, Options, Samples, Terms
from hmap_core.komo.scratch import new_multipliers, new_scratch
from hmap_core.komo.solver import solve, solve_from

ROUGH = 1e-2  # m, rad: how near its target a configuration has to come before its collisions are looked at


@nb.njit(**OPTIONS)
def _solve_configuration(X, prefix, chain, terms, cols, samples, o):
    """Solves a one-step problem in place, X (1, n): roughly without collisions; if that works, from there with them.

    Returns the worst violation; BEYOND where not even the first works.
    """
    n = X.shape[1]
    rough = Options(
        o.mu, o.mu_growth, o.mu_max, max(ROUGH, o.tolerance), o.outer, o.inner, o.iterations, o.max_step, o.damping,
        o.step_tolerance, o.gain_tolerance, o.acceleration, o.velocity, o.detection_distance, o.optimality, o.deadline,
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
        result[k] = _solve_configuration(X[k], prefix[k], chain, own, cols, samples, o)
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
        worst = _solve_configuration(X, prefix, chain, own, cols, samples, o)
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
