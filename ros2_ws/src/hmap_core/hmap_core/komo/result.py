"""What a solve returns."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class Status(StrEnum):
    """How a solve ended."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"  # some constraint stays violated at the steps or the samples
    BETWEEN_STEPS = "between steps"  # feasible there, but not between them
    TIME_LIMIT = "time limit"  # neither, and no time for another round


@dataclass(frozen=True)
class KomoResult:
    """What the solver found.

    Attributes:
        path: (T, n).
        feasible: every component within the tolerance at the steps and the samples, and verified between them.
        cost: of the sos objectives and the smoothness.
        worst_equality, worst_inequality: largest violations, m or rad.
        iterations: Newton steps, over all attempts.
        worst: the constraint that is violated the most, with its frames and its time in phases; empty if feasible.
        status: how it ended.
        attempts: first guesses tried.
        duration: s.
    """

    path: np.ndarray
    feasible: bool
    cost: float
    worst_equality: float
    worst_inequality: float
    iterations: int
    worst: str = ""
    status: Status = Status.FEASIBLE
    attempts: int = 1
    duration: float = 0.0

    @property
    def excess(self) -> float:
        """The larger of the two worst violations, m or rad."""
        return max(self.worst_equality, self.worst_inequality)
