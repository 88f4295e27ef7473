"""What is wrong with a path: which constraint it violates, in which part, and by how much."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class Part(StrEnum):
    """The parts of a path that are executed one after the other, each along a spline of its own."""

    COMING = "coming"  # transit and approach
    CARRYING = "carrying"  # in contact, along the object's path
    LEAVING = "leaving"  # retreat


@dataclass(frozen=True)
class Violation:
    """A minimum distance that the spline of a path violates between the steps.

    Attributes:
        part: of the path.
        amount: m.
        pair: the two that are too close.
    """

    part: Part
    amount: float
    pair: tuple[str, str]

    def __str__(self) -> str:
        return f"{self.part}, {' and '.join(self.pair)} are {self.amount * 1e3:.1f} mm too close between steps"


@dataclass(frozen=True)
class PathResult:
    """A path that was solved and verified, or why there is none.

    Attributes:
        path: (T, n) where it is feasible; else None.
        violations: what it violates between its steps, by part.
        unsolved: the constraint that the solver could not satisfy at the steps, in words.
    """

    path: np.ndarray | None = None
    violations: tuple[Violation, ...] = ()
    unsolved: str = ""

    @property
    def why(self) -> str:
        """What is wrong, in words; empty for a feasible path."""
        return self.unsolved or ", ".join(map(str, self.violations))

    def collides_first(self, part: Part) -> bool:
        """Whether a collision in this part is what goes wrong first."""
        return bool(self.violations) and self.violations[0].part == part
