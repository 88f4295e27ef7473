"""Linear programs in two variables, by Seidel's algorithm, compiled.

Constraints are added one after the other (Seidel, "Small-dimensional linear programming and convex hulls made easy",
1991). Where the optimum so far violates the next one, the new optimum lies on its line, and is that of a program in one
variable. Adding first the two that were active at the last optimum of a similar program saves most of these. Tolerances
and the treatment of parallel lines are those of TOPPRA's solver (Pham and Pham, T-RO 2018).
"""

import numba as nb

from hmap_core.collision.compile_options import PLAIN

ZERO = 1e-10  # coefficients below this are zero; constraints violated by less are met
PARALLEL = 1e-8  # violation at which parallel constraints leave no solution
LINE_END = 1e10  # a line's parameter beyond all bounds of the variables
NONE = -1  # row of no constraint: a bound of a variable is active instead
_BOUNDS = 4  # lower and upper, of both variables


@nb.njit(**PLAIN)
def _best_on_line(x, y, along_x, along_y, v, a, b, c, low, high, order, count):
    """Optimum on a line: the parameter t from its point (x, y) along its direction, and the constraint that ends it.

    The first ``count`` constraints in ``order`` and the bounds hold. The second result is an index into ``order``, or
    ``count`` and more for a bound, or NONE where there is no solution.
    """
    least, most, below, above = -LINE_END, LINE_END, NONE, NONE
    for j in range(count + _BOUNDS):
        if j < count:
            row = order[j]
            aj, bj, cj = a[row], b[row], c[row]
        elif j == count:
            aj, bj, cj = -1.0, 0.0, low[0]
        elif j == count + 1:
            aj, bj, cj = 1.0, 0.0, -high[0]
        elif j == count + 2:
            aj, bj, cj = 0.0, -1.0, low[1]
        else:
            aj, bj, cj = 0.0, 1.0, -high[1]
        slope = along_x * aj + along_y * bj
        violation = cj + y * bj + x * aj
        if slope > ZERO:
            if -violation / slope < most:
                most, above = -violation / slope, j
        elif slope < -ZERO:
            if -violation / slope > least:
                least, below = -violation / slope, j
        elif violation > PARALLEL:
            return 0.0, NONE
    if least > most:
        return 0.0, NONE
    if along_x * v[0] + along_y * v[1] < ZERO:
        return least, below
    return most, above


@nb.njit(**PLAIN)
def maximise(v, a, b, c, low, high, active, order, best):
    """Maximises ``v[0] x + v[1] y`` under ``a x + b y + c <= 0`` in all rows and ``low <= (x, y) <= high``.

    Args:
        v: (2,) the objective.
        a, b, c: (M,) constraints.
        low, high: (2,) bounds.
        active: (2,) int64, rows that are probably active; replaced by those that are, NONE for a bound.
        order: (M,) int64, scratch.
        best: (2,) the solution is written here.

    Returns:
        Whether there is a solution.
    """
    if low[0] > high[0] or low[1] > high[1]:
        return False
    for i in range(2):
        best[i] = high[i] if v[i] > ZERO else low[i]
    k = 0
    known = active[0] >= 0 and active[1] >= 0 and active[0] != active[1]
    if known:
        order[0], order[1] = active[1], active[0]
        k = 2
    for i in range(len(a)):
        if not known or (i != active[0] and i != active[1]):
            order[k] = i
            k += 1
    last, other = NONE, NONE
    for k in range(len(a)):
        i = order[k]
        if a[i] * best[0] + b[i] * best[1] + c[i] < ZERO:
            continue
        square = a[i] * a[i] + b[i] * b[i]
        x, y = -a[i] * c[i] / square, -b[i] * c[i] / square  # the line's nearest point to the origin
        t, j = _best_on_line(x, y, -b[i], a[i], v, a, b, c, low, high, order, k)
        if j == NONE:
            return False
        best[0], best[1] = x - t * b[i], y + t * a[i]
        last, other = i, order[j] if j < k else NONE
    active[0], active[1] = last, other
    return True
