"""Splines against SciPy's."""

import numpy as np
import pytest
from scipy import interpolate

from hmap_core.trajectory.spline import CubicSpline, natural_spline

RELATIVE = 1e-12  # of the largest value


def random_points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Knots (K,), spaced very unevenly, and values (K, n)."""
    rng = np.random.default_rng(seed)
    count = rng.integers(2, 40)
    return np.cumsum(10.0 ** rng.uniform(-3, 1, count)), rng.normal(size=(count, rng.integers(1, 8)))


def assert_same(curve, expected, x: np.ndarray):
    rng = np.random.default_rng(0)
    s = np.concatenate([x, rng.uniform(x[0], x[-1], 50), [x[0] - 0.1, x[-1] + 0.1]])
    for order in (0, 1, 2):
        values = expected(s, order)
        assert curve(s, order) == pytest.approx(values, rel=0.0, abs=RELATIVE * np.abs(values).max())
        assert curve(s[0], order) == pytest.approx(values[0], rel=0.0, abs=RELATIVE * np.abs(values).max())


@pytest.mark.parametrize("seed", range(50))
def test_natural_spline(seed):
    x, y = random_points(seed)
    assert_same(natural_spline(x, y), interpolate.CubicSpline(x, y, bc_type="natural"), x)


@pytest.mark.parametrize("seed", range(50))
def test_given_slopes(seed):
    x, y = random_points(seed)
    slopes = np.random.default_rng(seed).normal(size=y.shape)
    assert_same(CubicSpline(x, y, slopes), interpolate.CubicHermiteSpline(x, y, slopes), x)


def test_shapes_follow_the_parameters():
    curve = natural_spline(np.arange(3.0), np.zeros((3, 2)))
    assert curve(0.5).shape == (2,) and curve(np.zeros((4, 5)), 1).shape == (4, 5, 2)


def test_higher_orders_are_refused():
    with pytest.raises(ValueError, match="order = 3"):
        natural_spline(np.arange(3.0), np.zeros((3, 2)))(0.5, 3)


def bounded_points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Knots (K,) and values (K, n) in [-1, 1], many of them on the bounds."""
    rng = np.random.default_rng(seed)
    count = rng.integers(2, 20)
    return np.cumsum(rng.uniform(0.05, 1.0, count)), np.clip(1.5 * rng.uniform(-1.0, 1.0, (count, 5)), -1.0, 1.0)


@pytest.mark.parametrize("seed", range(50))
def test_bounds_are_kept_between_the_knots_and_nothing_else_changes(seed):
    x, y = bounded_points(seed)
    free = natural_spline(x, y)
    curve = free.within(-np.ones(5), np.ones(5))
    s = np.concatenate([np.linspace(a, b, 200) for a, b in zip(x, x[1:], strict=False)])
    values, before = curve(s), free(s)
    assert np.abs(values).max() <= 1.0 + 1e-12
    assert curve(x) == pytest.approx(y, abs=1e-12)
    inside = np.abs(before).max(axis=0) <= 1.0
    np.testing.assert_array_equal(values[:, inside], before[:, inside])
    slopes = curve(x[1:-1] - 1e-9, 1) - curve(x[1:-1] + 1e-9, 1)
    assert np.abs(slopes).max(initial=0.0) < 1e-5 * max(1.0, np.abs(curve(s, 2)).max())  # it has no corner


def test_a_curve_within_its_bounds_is_left_as_it_is():
    x, y = bounded_points(0)
    curve = natural_spline(x, y)
    assert curve.within(-10.0 * np.ones(5), 10.0 * np.ones(5)) is curve
