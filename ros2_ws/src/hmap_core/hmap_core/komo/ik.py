"""Inverse kinematics: path problems of one step, alone, in batches, and one after the other."""

import numpy as np

from hmap_core.deadline import check_time, deadline
from hmap_core.komo.ik_kernels import follow, solve_batch, solve_until
from hmap_core.komo.transcription import KomoProblem

AT_ONCE = 100_000  # pairs times configurations that are solved between two looks at the clock


def _one_step(problem: KomoProblem, params: np.ndarray):
    """What the compiled code takes of one-step problems with these parameters (K, N)."""
    check_time()
    padded = np.ascontiguousarray(np.concatenate([params, np.zeros((len(params), 1))], axis=1))
    terms, samples, options = problem.packed()
    return terms, padded, problem.arrays(), samples, options._replace(deadline=deadline())


def follow_ik(problem: KomoProblem, params: np.ndarray, start: np.ndarray, max_jump: float) -> np.ndarray:
    """Solves one-step problems one after the other, each from the last; returns the solutions (m, n) before the first
    that fails or that needs a joint to jump by more than ``max_jump``."""
    terms, padded, cols, samples, options = _one_step(problem, params)
    start = np.ascontiguousarray(start, float)
    Q, count = follow(start, problem.chain, terms, padded, cols, samples, options, max_jump)
    return Q[:count]


def solve_ik(
    problem: KomoProblem, params: np.ndarray, starts: np.ndarray, near: np.ndarray | None = None
) -> np.ndarray | None:
    """Solves a one-step problem from one start after the other until one is feasible.

    Args:
        problem: a problem of one phase and one step.
        params: (N,) all objective parameters, in order.
        starts: (K, n).
        near: (n,) or (K, n) the configuration to stay near; by default each start itself.

    Returns:
        A configuration (n,), or None.
    """
    terms, padded, cols, samples, options = _one_step(problem, params[None])
    starts = np.ascontiguousarray(starts, float)
    near = starts if near is None else np.ascontiguousarray(np.broadcast_to(near, starts.shape), float)
    q, violation = solve_until(starts, near, problem.chain, terms, padded[0], cols, samples, options)
    return q if violation <= problem.options.tolerance and np.isfinite(q).all() else None


def solve_ik_batch(problem: KomoProblem, params: np.ndarray, initial: np.ndarray, near: np.ndarray):
    """Solves many one-step problems of one structure.

    Args:
        problem: a problem of one phase and one step.
        params: (K, N) all objective parameters of each instance, in order.
        initial, near: (K, n) where each starts, and the configuration it should stay near.

    Returns:
        (q (K, n), feasible (K,)).
    """
    X = np.ascontiguousarray(initial, float)[:, None, :].copy()
    prefix = np.ascontiguousarray(np.repeat(np.asarray(near, float)[:, None, :], 2, axis=1))
    terms, padded, cols, samples, options = _one_step(problem, params)
    violation = np.empty(len(X))
    for some in np.array_split(np.arange(len(X)), max(1, min(len(X), len(X) * len(cols.a) // AT_ONCE))):
        check_time()
        own = slice(some[0], some[-1] + 1) if len(some) else slice(0)
        violation[own] = solve_batch(X[own], prefix[own], problem.chain, terms, padded[own], cols, samples, options)
    feasible = (violation <= problem.options.tolerance) & np.isfinite(X).all((1, 2))
    return X[:, 0], feasible
