"""Violated constraints in words: which one, of which frames, by how much, and when."""

from dataclasses import dataclass

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.linearisation import Linearisation
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.problem import PathProblem
from hmap_core.komo.sweep import between_violations

VERIFY_STEP = 0.0005  # m of motion after which a pair is looked at again at the latest


@dataclass(frozen=True)
class Violation:
    """Something violated in the interval before ``step``, at ``alpha`` of it.

    Attributes:
        amount: m or rad.
        objective: its index; None for a pair that comes too near.
        text: for people.
    """

    step: int
    alpha: float
    amount: float
    objective: int | None
    text: str


def of_objective(problem: PathProblem, objective: Objective, component: int, off: float, at: float) -> str:
    """A component of an objective that is off (m, rad) at ``at`` steps since the start."""
    used = [str(f) for f in objective.feature.frames if 0 <= f <= len(problem.chain.lower)]
    frames = f" of frames {', '.join(used)}" if used else ""
    kind = objective.type.name.lower()
    return f"{kind} {objective.feature.name}[{component}]{frames} off by {off:.2g} at time {problem.time_of(at):.2f}"


def of_pair(problem: PathProblem, pair: int, amount: float, at: float) -> str:
    """A pair that is nearer than its minimum distance by ``amount`` (m) at ``at`` steps since the start."""
    a, b = problem.collisions.pair_name(int(pair))
    return f"{a} and {b} closer than allowed by {amount * 1e3:.2g} mm at time {problem.time_of(at):.2f}"


def worst_violation(problem: PathProblem, linear: Linearisation, path: np.ndarray, cols: Collisions) -> str:
    """The constraint that a path (T + 1, n), with its start, violates the most.

    Args:
        linear: of the path, with the values of all objectives.
        cols: pairs and minimum distances that count.
    """
    worst, text = -np.inf, ""
    types = np.array([problem.objectives[index].type for index, _, _ in linear.rows], int)
    off = np.where(types == ObjectiveType.EQ, np.abs(linear.values), linear.values)
    off[types == ObjectiveType.SOS] = -np.inf
    if len(off) and off.max() > worst:
        worst = off.max()
        index, step, component = linear.rows[int(off.argmax())]
        text = of_objective(problem, problem.objectives[index], component, worst, step + 1.0)
    excess = np.maximum(problem.chain.lower - path[1:], path[1:] - problem.chain.upper)
    step, joint = map(int, np.unravel_index(int(excess.argmax()), excess.shape))
    amount, time = excess[step, joint], problem.time_of(step + 1.0)
    if amount > worst:
        worst, text = amount, f"joint {joint + 1} exceeds its limit by {amount:.2g} at time {time:.2f}"
    violation, pair, alpha = between_violations(path, problem.masks(), problem.chain, cols, VERIFY_STEP)
    step = int(violation.argmax())
    if pair[step] >= 0 and violation[step] > worst:
        text = of_pair(problem, pair[step], violation[step], step + alpha[step])
    return text
