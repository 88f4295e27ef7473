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

from hmap_core.clock import now
from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.pairs import BEYOND
from hmap_core.komo.banded import PADDING
from hmap_core.komo.collision_rows import NEVER
from hmap_core.komo.lagrangian import evaluate
from hmap_core.komo.newton import model_step
from hmap_core.komo.scratch import new_model, new_multipliers, new_scratch

# a round that leaves more than this share of the violation stalls; after so many in a row the solve ends
STALL, STALLS = 0.8, 8
# shares of what the slope promises (a quadratic gives half) below which a step is refused, the next one is damped
# more, and above which it is damped less
LEAST_GAIN, POOR_GAIN, GOOD_GAIN = 0.01, 0.15, 0.35
TRIES = 10  # steps tried from one path, with more and more damping
NO_NUMBER = 1e300  # a merit that is not below this is no number: some target or parameter is none
ENOUGH = 0.25  # share of the last round's violation from which the penalty is left as it is


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
        merit, cost, worst_eq, worst_ineq, change = evaluate(
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
                if o.deadline < np.inf and now() > o.deadline:
                    return cost, BEYOND, BEYOND, iterations
                if not model_step(X, prefix, chain, mult, model, damping, bandwidth, A, b, gradient, step):
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
                trial, trial_cost, trial_eq, trial_ineq, _ = evaluate(
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
