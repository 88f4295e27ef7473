"""Cubic splines through the points of a joint path.

SciPy's ``CubicSpline`` and ``CubicHermiteSpline`` give the same curves to the last bit, but ``scipy.interpolate``
takes longer to import than a plan takes to compute.
"""

import numpy as np
from scipy.linalg import solve_banded


class CubicSpline:
    """A curve of cubic polynomials, one between each two knots.

    Attributes:
        x: (K,) knots, increasing.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, slopes: np.ndarray):
        """
        Args:
            x: (K,) knots, increasing, K >= 2.
            y: (K, n) values at the knots.
            slopes: (K, n) derivatives at the knots.
        """
        self.x = x
        dx = np.diff(x)[:, None]
        chord = np.diff(y, axis=0) / dx
        curvature = (slopes[:-1] + slopes[1:] - 2.0 * chord) / dx
        self._c = y[:-1], slopes[:-1], (chord - slopes[:-1]) / dx - curvature, curvature / dx

    def __call__(self, s, order: int = 0) -> np.ndarray:
        """Values (..., n), or derivatives of order 1 or 2, at parameters (...); the outer polynomials go on outside."""
        s = np.asarray(s, float)
        k = self.x[1:-1].searchsorted(s, side="right")
        t = (s - self.x[k])[..., None]
        c0, c1, c2, c3 = (c.take(k, axis=0) for c in self._c)
        if order == 0:
            return c0 + c1 * t + c2 * (t * t) + c3 * (t * t * t)
        if order == 1:
            return c1 + c2 * t * 2.0 + c3 * (t * t) * 3.0
        if order == 2:
            return c2 * 2.0 + c3 * t * 6.0
        raise ValueError(f"order = {order}; allowed are 0, 1 and 2")


def natural_spline(x: np.ndarray, y: np.ndarray) -> CubicSpline:
    """The spline without curvature at both ends (de Boor, "A Practical Guide to Splines", 1978, chapter IV).

    Args:
        x: (K,) knots, increasing, K >= 2.
        y: (K, n) values at the knots.
    """
    dx = np.diff(x)
    chord = np.diff(y, axis=0) / dx[:, None]
    bands, right = np.zeros((3, len(x))), np.empty_like(y)
    bands[0, 1], bands[0, 2:] = dx[0], dx[:-1]
    bands[1, 0], bands[1, 1:-1], bands[1, -1] = 2.0 * dx[0], 2.0 * (dx[:-1] + dx[1:]), 2.0 * dx[-1]
    bands[2, :-2], bands[2, -2] = dx[1:], dx[-1]
    right[0], right[-1] = 3.0 * (y[1] - y[0]), 3.0 * (y[-1] - y[-2])
    right[1:-1] = 3.0 * (dx[1:, None] * chord[:-1] + dx[:-1, None] * chord[1:])
    return CubicSpline(x, y, solve_banded((1, 1), bands, right, check_finite=False))
