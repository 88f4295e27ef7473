"""Seidel's algorithm against SciPy's solver."""

import numpy as np
import pytest
from scipy.optimize import linprog

from hmap_core.trajectory.linear_program import NONE, maximise

SIZE = 10.0  # of the box in which the variables are


def solve(v, rows, active=(NONE, NONE), low=(-SIZE, -SIZE), high=(SIZE, SIZE)):
    """Optimum (2,), or None; and the active rows (2,). ``rows`` (M, 3) are a, b, c of ``a x + b y + c <= 0``."""
    a, b, c = np.array(rows, float).reshape(-1, 3).T.copy()
    active, best = np.array(active), np.zeros(2)
    v, low, high = (np.array(each, float) for each in (v, low, high))
    found = maximise(v, a, b, c, low, high, active, np.zeros(len(a), np.int64), best)
    return (best if found else None), active


def random_program(seed: int):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(rng.integers(0, 30), 3))
    rows[:, 2] -= rng.uniform(0.0, 2.0)  # the more, the more often there is a solution
    return rng.normal(size=2), rows


def scipy_optimum(v, rows):
    constraints = {"A_ub": rows[:, :2], "b_ub": -rows[:, 2]} if len(rows) else {}
    result = linprog(-v, bounds=[(-SIZE, SIZE)] * 2, **constraints)
    assert result.status in (0, 2)
    return result.x if result.status == 0 else None


@pytest.mark.parametrize("seed", range(200))
def test_optimum_is_that_of_scipy(seed):
    v, rows = random_program(seed)
    (best, active), expected = solve(v, rows), scipy_optimum(v, rows)
    assert (best is None) == (expected is None)
    if best is None:
        return
    assert v @ best == pytest.approx(v @ expected, abs=1e-7)
    assert (rows[:, :2] @ best + rows[:, 2] < 1e-7).all()
    for row in active[active != NONE]:
        assert rows[row, :2] @ best + rows[row, 2] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("seed", range(50))
def test_the_first_guess_of_the_active_rows_does_not_change_the_optimum(seed):
    v, rows = random_program(seed)
    cold, active = solve(v, rows)
    if cold is None or len(rows) < 2:
        return
    for guess in (active, (0, 1), (len(rows) - 1, 0)):
        warm, _ = solve(v, rows, guess)
        assert v @ warm == pytest.approx(v @ cold, abs=1e-9)


def test_without_constraints_the_bounds_end_the_search():
    best, active = solve((1.0, -1.0), [])
    assert best.tolist() == [SIZE, -SIZE] and active.tolist() == [NONE, NONE]


def test_bounds_that_leave_one_value():
    best, _ = solve((1.0, 1.0), [[1.0, 1.0, -3.0]], low=(-SIZE, 2.0), high=(SIZE, 2.0))
    assert best == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("rows", "low"),
    [([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]], (-SIZE, -SIZE)), ([[0.0, 0.0, 1.0]], (-SIZE, -SIZE)), ([], (SIZE + 1, 0.0))],
    ids=["parallel", "no coefficients", "bounds"],
)
def test_no_solution(rows, low):
    assert solve((1.0, 1.0), rows, low=low)[0] is None
