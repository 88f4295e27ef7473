"""What a path violates between its steps, and where it has to be looked at because of it."""

from collections.abc import Sequence

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.allowances import verification
from hmap_core.komo.features.base import MAX_DIM, MAX_FRAMES
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.problem import PathProblem
from hmap_core.komo.sweep import Rows, between_violations, left_between
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
    return _too_near(problem, path, cols) + _left(problem, path)


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


def _left(problem: PathProblem, path: np.ndarray) -> list[Violation]:
    """Where constraints that hold at both ends of an interval are left between them."""
    chosen = [index for index, objective in enumerate(problem.objectives) if _holds_between(objective)]
    if not chosen:
        return []
    index, rows = _rows([problem.objectives[k] for k in chosen])
    place, component, amount = left_between(path, problem.chain, rows, BETWEEN)
    found = []
    for m in np.flatnonzero(place >= 0):
        number = chosen[index[m]]
        step, alpha = int(rows.step[m]), float(BETWEEN[place[m]])
        off, objective = float(amount[m]), problem.objectives[number]
        text = of_objective(problem, objective, int(component[m]), off, step + alpha)
        found.append(Violation(step, alpha, off, number, text))
    return found


def _holds_between(objective: Objective) -> bool:
    """Whether an objective is a constraint that holds all along some intervals."""
    constant = objective.params is None and objective.order == 0
    return constant and objective.type != ObjectiveType.SOS and len(objective.steps) > 1


def _rows(objectives: Sequence[Objective]) -> tuple[np.ndarray, Rows]:
    """The objectives at each of their steps, by ascending step; and which one each row is of."""
    count = len(objectives)
    features = [o.feature for o in objectives]
    table = np.zeros((count, 4 + MAX_FRAMES), np.int64)
    target, tolerance = np.zeros((count, MAX_DIM)), np.ones((count, MAX_DIM))
    offset = 0
    for k, (o, f) in enumerate(zip(objectives, features, strict=True)):
        table[k, : 4 + len(f.frames)] = f.kernel, f.dim, offset, o.type == ObjectiveType.EQ, *f.frames
        offset += len(f.params)
        tolerance[k, : f.lengths], tolerance[k, f.lengths :] = BETWEEN_TOLERANCE
        if o.target is not None:
            target[k, : f.dim] = o.target
    index = np.repeat(np.arange(count), [len(o.steps) for o in objectives])
    step = np.array([t for o in objectives for t in o.steps], np.int64)
    order = step.argsort(kind="stable")
    index = index[order]
    kernel, dim, begin, equality = table[:, :4].T.take(index, axis=1)
    params = np.concatenate([*(f.params for f in features), np.zeros(1)])
    return index, Rows(
        step[order], kernel, dim, table[:, 4:].take(index, axis=0), begin, params, target.take(index, axis=0),
        tolerance.take(index, axis=0), equality,
    )  # fmt: skip
