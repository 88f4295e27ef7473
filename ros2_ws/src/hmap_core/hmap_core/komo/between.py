"""What a path violates between its steps, and where it has to be looked at because of it."""

from collections.abc import Sequence

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.allowances import verification
from hmap_core.komo.features.base import MAX_FRAMES
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.problem import PathProblem
from hmap_core.komo.solver import between_violations, feature_values
from hmap_core.komo.violations import VERIFY_STEP, Violation, of_objective, of_pair

SAMPLE_GAP = 0.02  # share of an interval within which two collision samples count as one
BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])  # shares of an interval at which constraints of both its ends are verified
# Between its steps a constraint of both ends of an interval may be left by this: m, and rad or share of a unit vector.
# Where it is left by more it is asked there too, to within the band.
BETWEEN_TOLERANCE = (5e-4, 4e-3)
BETWEEN_BAND = (3e-4, 2e-3)


def by_unit(objective: Objective, values: tuple[float, float]) -> np.ndarray:
    """(dim,) the first value for lengths, the second for angles and directions."""
    return np.where(np.arange(objective.feature.dim) < objective.feature.lengths, *values)


def violated_between(problem: PathProblem, path: np.ndarray, cols: Collisions) -> list[Violation]:
    """What a path (T + 1, n), with its start, violates between its steps: the worst of each interval and constraint."""
    found = _too_near(problem, path, cols)
    for index, objective in enumerate(problem.objectives):
        found += _left(problem, index, objective, path)
    return found


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


def _left(problem: PathProblem, index: int, objective: Objective, path: np.ndarray) -> list[Violation]:
    """Where a constraint that holds at both ends of an interval is left between them."""
    constant = objective.params is None and objective.order == 0
    if not constant or objective.type == ObjectiveType.SOS or len(objective.steps) < 2:
        return []
    value = _values_between(problem, objective, path)
    off = (np.abs(value) if objective.type == ObjectiveType.EQ else value) / by_unit(objective, BETWEEN_TOLERANCE)
    found = []
    for k in np.flatnonzero((off[:, 0] <= 1.0).all(1) & (off > 1.0).any((1, 2))):
        place, component = np.unravel_index(int(off[k].argmax()), off[k].shape)
        step, alpha = int(objective.steps[k]), float(BETWEEN[place])
        amount = abs(float(value[k, place, component]))
        text = of_objective(problem, objective, int(component), amount, step + alpha)
        found.append(Violation(step, alpha, amount, index, text))
    return found


def _values_between(problem: PathProblem, objective: Objective, path: np.ndarray) -> np.ndarray:
    """Values (steps, len(BETWEEN), dim) of an objective in the intervals before its steps, less its target."""
    feature = objective.feature
    steps = np.asarray(objective.steps)
    before = path[steps][:, None]
    points = before + BETWEEN[:, None] * (path[steps + 1][:, None] - before)
    frames = np.zeros(MAX_FRAMES, np.int64)
    frames[: len(feature.frames)] = feature.frames
    value = feature_values(
        points.reshape(-1, path.shape[1]), problem.chain, feature.kernel, feature.dim, frames, feature.params
    )
    if objective.target is not None:
        value -= objective.target
    return value.reshape(len(steps), len(BETWEEN), -1)
