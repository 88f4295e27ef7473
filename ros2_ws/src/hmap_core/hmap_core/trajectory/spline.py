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
        y: (K, n) values at the knots.
        slopes: (K, n) derivatives at the knots.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, slopes: np.ndarray):
        """
        Args:
            x: (K,) knots, increasing, K >= 2.
            y: (K, n) values at the knots.
            slopes: (K, n) derivatives at the knots.
        """
        self.x, self.y, self.slopes = x, y, slopes
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

    def within(self, lower: np.ndarray, upper: np.ndarray) -> "CubicSpline":
        """The curve through the same points that does not leave bounds between its knots.

        A cubic polynomial lies in the convex hull of its Bezier control points. So slopes that put these within the
        bounds are enough, as for monotone interpolation (Fritsch and Carlson, "Monotone Piecewise Cubic
        Interpolation", 1980). Only columns of the curve that leave their bounds are changed; there, the second
        derivative may jump at the knots.

        Args:
            lower, upper: (n,) bounds; all values at the knots are within them.
        """
        thirds = np.diff(self.x)[:, None] / 3.0
        controls = np.stack([self.y[:-1] + thirds * self.slopes[:-1], self.y[1:] - thirds * self.slopes[1:]])
        if ((controls >= lower) & (controls <= upper)).all():
            return self
        low, high = self._extremes()
        outside = (low < lower) | (high > upper)
        if not outside.any():
            return self
        largest, least = (upper - self.y)[:, outside], (lower - self.y)[:, outside]
        slopes = self.slopes.copy()
        bounded = slopes[:, outside]
        bounded[:-1] = np.clip(bounded[:-1], least[:-1] / thirds, largest[:-1] / thirds)
        bounded[1:] = np.clip(bounded[1:], -largest[1:] / thirds, -least[1:] / thirds)
        slopes[:, outside] = bounded
        return CubicSpline(self.x, self.y, slopes)

    def _extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest values (n,) from the first knot to the last."""
        c0, c1, c2, c3 = self._c
        with np.errstate(divide="ignore", invalid="ignore"):  # where there are none
            larger = -c2 - np.copysign(np.sqrt(c2 * c2 - 3.0 * c3 * c1), c2)
            turns = np.stack([larger / (3.0 * c3), c1 / larger])
        inside = (turns > 0.0) & (turns < np.diff(self.x)[:, None])
        t = np.where(inside, turns, 0.0)
        values = np.concatenate([(c0 + t * (c1 + t * (c2 + t * c3))).reshape(-1, c0.shape[1]), self.y])
        return values.min(axis=0), values.max(axis=0)


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
