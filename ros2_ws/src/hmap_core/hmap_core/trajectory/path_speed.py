"""The fastest speed along a path under joint limits, from rest to rest.

TOPPRA's two passes (Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis", T-RO 2018) for limits that are the same both ways: standing still is then controllable everywhere, so only
the upper ends of the controllable sets are needed. Each grid point has a linear program in u = s'' and x = s'^2.
"""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS, PLAIN
from hmap_core.trajectory.linear_program import NONE, maximise

TINY = 1e-9  # weight of the path acceleration where only the speed matters, as in TOPPRA
RETRIES = 10  # reductions of one speed from which rounding leaves no way on
KEPT = 0.999  # of the squared speed in one of them
SLACK = 0.9999  # share of the squared speed that is kept, so that rounding leaves a way on
LEAST = 1e-8  # squared speed by which either reduces it at most
BOUND = 1e8  # of u and x; never active at a solution, as in TOPPRA


def fastest_speed(
    grid: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    most_squared: np.ndarray,
) -> np.ndarray | None:
    """Speeds (N + 1,) at the grid points (N + 1,) of a path's parameter, zero at both ends; None where none were found.

    Args:
        grid: (N + 1,) values of the parameter, increasing.
        first, second: (N + 1, n) derivatives of the joints by the parameter.
        velocity, acceleration: (n,) their limits; parameter and time are scaled so that all is of order one.
        most_squared: (N + 1,) further upper bounds of the squared speed; infinite where there is none.
    """
    steps = np.diff(grid)
    a, b = _acceleration_rows(steps, first, second)
    c = np.concatenate([np.zeros(2), -np.tile(acceleration, 4)])
    with np.errstate(divide="ignore"):
        most = np.minimum(((velocity / np.abs(first)) ** 2).min(axis=1), np.minimum(most_squared, BOUND))
    squared = np.zeros(len(grid))
    return np.sqrt(squared) if _fastest_squared(steps, a, b, c, most, squared) else None


def _acceleration_rows(steps: np.ndarray, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients a, b (N + 1, 2 + 4 n) of ``a u + b x + c <= 0``; accelerations hold at both ends of every interval.

    The first two rows, which are left empty, are for the limits of x at the next grid point.
    """
    ahead = np.concatenate([first[1:] + 2.0 * steps[:, None] * second[1:], first[-1:]])
    a = np.concatenate([first, ahead], axis=1)
    b = np.concatenate([second, np.concatenate([second[1:], second[-1:]])], axis=1)
    empty = np.zeros((len(first), 2))
    return np.concatenate([empty, a, -a], axis=1), np.concatenate([empty, b, -b], axis=1)


@nb.njit(**PLAIN)
def _reduced(x, kept):
    return max(x - LEAST, kept * x)


@nb.njit(**OPTIONS)
def _fastest_squared(steps, a, b, c, most, squared):
    """Writes the squared speeds at the grid points to ``squared`` (N + 1,), which is zero; whether there are any.

    Args:
        steps: (N,) between grid points.
        a, b, c: the constraints at each grid point, see :func:`_acceleration_rows`; c (2 + 4 n,) is that of all.
        most: (N + 1,) largest x at each grid point.
    """
    N = len(steps)
    highest = np.zeros(N + 1)
    active, order = np.full(2, NONE), np.zeros(len(c), np.int64)
    v, low, high, best = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    for i in range(N - 1, -1, -1):
        _limit_next(i, steps[i], highest[i + 1], a, b, c)
        v[0], v[1] = -TINY, 1.0
        low[0], high[0], low[1], high[1] = -BOUND, BOUND, 0.0, most[i]
        if not maximise(v, a[i], b[i], c, low, high, active, order, best):
            return False
        highest[i] = best[1]
    retries = i = 0
    while i < N:
        x = squared[i]
        _limit_next(i, steps[i], highest[i + 1], a, b, c)
        v[0], v[1] = 2.0 * steps[i], 1.0
        low[1], high[1] = max(0.0, x), min(most[i], x)
        if maximise(v, a[i], b[i], c, low, high, active, order, best):
            squared[i + 1] = min(max(_reduced(x + 2.0 * steps[i] * best[0], SLACK), 0.0), highest[i + 1])
            retries, i = 0, i + 1
        elif retries < RETRIES:
            squared[i] = _reduced(x, KEPT)
            retries += 1
        else:
            return False
    return True


@nb.njit(**PLAIN)
def _limit_next(i, step, highest, a, b, c):
    """``0 <= x + 2 step u <= highest``: the first two constraints at grid point i."""
    a[i, 0], b[i, 0], c[0] = -2.0 * step, -1.0, 0.0
    a[i, 1], b[i, 1], c[1] = 2.0 * step, 1.0, -highest
