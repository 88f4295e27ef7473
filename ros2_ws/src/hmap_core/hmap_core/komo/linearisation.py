"""Values and Jacobian of the objectives of a path, for tests and for other solvers."""

from dataclasses import dataclass

import numpy as np

from hmap_core.komo import objective_rows
from hmap_core.komo.arrays import Samples, Terms
from hmap_core.komo.problem import PathProblem


@dataclass(frozen=True)
class Linearisation:
    """Objectives at a path: values (M,) less targets, unscaled; jacobian (M, T n); rows: objective, step, component."""

    values: np.ndarray
    jacobian: np.ndarray
    rows: list[tuple[int, int, int]]


def linearise(
    problem: PathProblem, terms: Terms, samples: Samples, path: np.ndarray, start: np.ndarray
) -> Linearisation:
    """All objectives of a problem, with its terms at its steps only, at a path (T, n) after ``start`` (n,)."""
    n = len(start)
    X = np.ascontiguousarray(path, float)
    prefix = np.ascontiguousarray([start, start], float)
    found, J = objective_rows.linearise(X, prefix, problem.chain, terms, problem.arrays(), samples)
    count = len(terms.step)
    rows = [(int(terms.objective[m]), int(terms.step[m]), d) for m in range(count) for d in range(terms.dim[m])]
    values = np.array([found[m, d] for m in range(count) for d in range(terms.dim[m])])
    jacobian = np.zeros((len(rows), X.size))
    at = 0
    for m in range(count):
        for d in range(terms.dim[m]):
            for k in range(min(terms.order[m], terms.step[m]) + 1):
                column = n * (terms.step[m] - k)
                jacobian[at, column : column + n] = J[m, d, n * k : n * (k + 1)]
            at += 1
    return Linearisation(values, jacobian, rows)
