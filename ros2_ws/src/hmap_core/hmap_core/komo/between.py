"""What a path violates between its steps, and where it has to be looked at because of it."""

from collections.abc import Sequence

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.allowances import verification
from hmap_core.komo.arrays import Terms
from hmap_core.komo.features.base import MAX_DIM
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.problem import PathProblem
from hmap_core.komo.sweep import between_violations, left_between
from hmap_core.komo.violations import VERIFY_STEP, Violation, of_objective, of_pair

SAMPLE_GAP = 0.02  # share of an interval within which two collision samples count as one
BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])  # shares of an interval at which constraints of both its ends are verified
# Between its steps a constraint of both ends of an interval may be left by this: m, and rad or share of a unit vector.
# Where it is left by more it is asked there too, to within the band.
BETWEEN_TOLERANCE = (5e-4, 4e-3)
BETWEEN_BAND = (3e-4, 2e-3)


def by_unit(objective: Objective, values: tuple[float, float]) -> list[float]:
    """For each of the dim components the first value for lengths, the second for angles and directions."""
    lengths, dim = objective.feature.lengths, objective.feature.dim
    return [values[0]] * lengths + [values[1]] * (dim - lengths)


def violated_between(problem: PathProblem, path: np.ndarray, cols: Collisions, terms: Terms) -> list[Violation]:
    """What a path (T + 1, n), with its start, violates between its steps: the worst of each interval and constraint."""
    return _too_near(problem, path, cols) + _left(problem, path, terms)


def new_place(substeps: int, known: Sequence[tuple[int, float]], step: int, alpha: float) -> tuple[int, float]:
    """Where a violated interval is to be looked at: at the worst place, or, if that is known, beside it.

    Args:
        substeps: regular samples per interval.
        known: (step, alpha) of the other samples.
    """
    regular = np.arange(substeps + 1) / substeps
    places = np.sort(np.concatenate([regular, [a for t, a in known if t == step]]))
    if np.abs(places - alpha).min() > SAMPLE_GAP:
        return step, alpha
    gap = int(np.argmax(np.diff(places)))
    return step, float(places[gap : gap + 2].mean())


def _too_near(problem: PathProblem, path: np.ndarray, cols: Collisions) -> list[Violation]:
    """The pair that comes nearest beyond what it may, in each interval."""
    masks = problem.masks()
    amount, pair, alpha = between_violations(path, masks, problem.chain, verification(cols), VERIFY_STEP)
    return [
        Violation(int(t), float(alpha[t]), float(amount[t]), None, of_pair(problem, pair[t], amount[t], t + alpha[t]))
        for t in np.flatnonzero(pair >= 0)
    ]


def _left(problem: PathProblem, path: np.ndarray, terms: Terms) -> list[Violation]:
    """Where constraints that hold at both ends of an interval are left between them."""
    tolerance = np.zeros((len(problem.objectives), MAX_DIM))
    for k, objective in enumerate(problem.objectives):
        constant = objective.params is None and objective.order == 0
        if constant and objective.type != ObjectiveType.SOS and len(objective.steps) > 1:
            tolerance[k, : objective.feature.dim] = by_unit(objective, BETWEEN_TOLERANCE)
    if not tolerance.any():
        return []
    place, component, amount = left_between(path, problem.chain, terms, tolerance, BETWEEN)
    found = []
    for m in np.flatnonzero(place >= 0):
        index, step = int(terms.objective[m]), int(terms.step[m])
        alpha, off = float(BETWEEN[place[m]]), float(amount[m])
        text = of_objective(problem, problem.objectives[index], int(component[m]), off, step + alpha)
        found.append(Violation(step, alpha, off, index, text))
    return found
