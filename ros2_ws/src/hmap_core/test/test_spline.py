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
