"""The fastest speed along a path under joint limits, from rest to rest.

TOPPRA's two passes (Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis", T-RO 2018) over its compiled linear programs, in what they come to for limits that are the same both ways:
standing still is then controllable everywhere, so only the upper ends of the controllable sets are needed.
"""

import numpy as np
from toppra.constraint import DiscretizationType, LinearConstraint
from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper

TINY = 1e-9  # weight of the path acceleration where only the speed matters, as in TOPPRA
RETRIES = 10  # reductions of one speed from which rounding leaves no way on
KEPT = 0.999  # of the squared speed in one of them
SLACK = 0.9999  # share of the squared speed that is kept, so that rounding leaves a way on
LEAST = 1e-8  # squared speed by which either reduces it at most


class _JointLimits(LinearConstraint):
    """Limits of joint velocity and acceleration at grid points; accelerations hold at both ends of every interval."""

    def __init__(self, first: np.ndarray, second: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray):
        super().__init__()
        self.discretization_type = DiscretizationType.Interpolation
        self.identical = True
        self.dof = first.shape[1]
        self._first, self._second, self._velocity, self._acceleration = first, second, velocity, acceleration

    def compute_constraint_params(self, path, gridpoints: np.ndarray, *args, **kwargs):
        """Coefficients a, b, c, F, g, u-bound, x-bound of ``F (a u + b x + c) <= g`` for u = s'', x = s'^2."""
        first, second = self._first, self._second
        step = 2.0 * np.diff(gridpoints)[:, None]
        ahead = np.concatenate([first[1:] + step * second[1:], first[-1:]])
        a = np.concatenate([first, ahead], axis=1)
        b = np.concatenate([second, np.concatenate([second[1:], second[-1:]])], axis=1)
        F = np.concatenate([np.eye(2 * self.dof), -np.eye(2 * self.dof)])
        with np.errstate(divide="ignore"):
            most = ((self._velocity / np.abs(first)) ** 2).min(axis=1)
        x_bound = np.column_stack([np.zeros(len(most)), most])
        return a, b, np.zeros_like(a), F, np.tile(self._acceleration, 4), None, x_bound


def fastest_speed(
    grid: np.ndarray, first: np.ndarray, second: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> np.ndarray | None:
    """Speeds (N + 1,) at the grid points (N + 1,) of a path's parameter, zero at both ends; None where none were found.

    Args:
        first, second: (N + 1, n) derivatives of the joints by the parameter.
        velocity, acceleration: (n,) their limits; parameter and time are scaled so that all is of order one.
    """
    N = len(grid) - 1
    solver = seidelWrapper([_JointLimits(first, second, velocity, acceleration)], None, grid)
    solver.setup_solver()
    highest = np.zeros(N + 1)
    faster = np.array([TINY, -1.0])
    for i in range(N - 1, -1, -1):
        highest[i] = solver.solve_stagewise_optim(i, None, faster, np.nan, np.nan, 0.0, highest[i + 1])[1]
        if np.isnan(highest[i]):
            return None
    squared = np.zeros(N + 1)
    steps = 2.0 * np.diff(grid)
    retries = i = 0
    while i < N:
        x = squared[i]
        u = solver.solve_stagewise_optim(i, None, np.array([-steps[i], -1.0]), x, x, 0.0, highest[i + 1])[0]
        if not np.isnan(u):
            squared[i + 1] = min(max(_reduced(x + steps[i] * u, SLACK), 0.0), highest[i + 1])
            retries, i = 0, i + 1
        elif retries < RETRIES:
            squared[i] = _reduced(x, KEPT)
            retries += 1
        else:
            return None
    solver.close_solver()
    return np.sqrt(squared)


def _reduced(x: float, kept: float) -> float:
    return max(x - LEAST, kept * x)
