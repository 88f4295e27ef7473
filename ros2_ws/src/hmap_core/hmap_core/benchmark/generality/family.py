"""Families of generated tasks: what they are called, how they are built, and what is expected of a planner."""

import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hmap_core.benchmark.generality.cell import Cell, Sampler
from hmap_core.evaluation.trial import NOT_VALID, TrialResult
from hmap_core.exceptions import Code

PLANNED = "PLANNED"  # code of a result with a plan for a task that has no solution
WRONG_REASON = "refused for another reason than the expected one"
Build = Callable[[Cell, Sampler], None]


@dataclass(frozen=True)
class Refusal:
    """How a planner has to refuse a task that has no solution.

    Attributes:
        codes: the allowed codes of the failure.
        reason: regular expression, without regard to case, that the reason of the failure has to match.
    """

    codes: frozenset[Code]
    reason: str

    def __call__(self, code: str, reason: str) -> bool:
        """Whether a failure is the expected one.

        Args:
            code: name of a :class:`~hmap_core.exceptions.Code`.
            reason: text of the failure.
        """
        return code in {allowed.name for allowed in self.codes} and bool(re.search(self.reason, reason, re.IGNORECASE))


@dataclass(frozen=True)
class Family:
    """Tasks of one kind, drawn at random.

    Attributes:
        name: letters, digits and ``_``.
        description: of the task, one line.
        build: adds bodies, robots and the goal to an empty cell.
        refusal: how its tasks have to be refused; None if they have solutions.
    """

    name: str
    description: str
    build: Build
    refusal: Refusal | None = None

    def cell(self, seed: int) -> Cell:
        """The task of a seed, 0 or larger. The same seed gives the same task on every machine."""
        cell = Cell(f"{self.name}-{seed}", f"{self.description} Generated: family {self.name}, seed {seed}.")
        self.build(cell, Sampler(np.random.default_rng((zlib.crc32(self.name.encode()), seed))))
        return cell

    def judged(self, result: TrialResult) -> TrialResult:
        """A result as this family sees it.

        Args:
            result: of a trial of one of its tasks.

        Returns:
            The result as it is, if the tasks have solutions. Otherwise a refusal counts as valid; it is solved if code
            and reason are the expected ones, and a plan is a failure.
        """
        if self.refusal is None:
            return result
        if result.valid or result.code == NOT_VALID:
            return replace(result, valid=False, solved=False, code=PLANNED, reason="a plan was found where none exists")
        right = self.refusal(result.code, result.reason)
        reason = "" if right else f"{WRONG_REASON}: {result.reason}"
        return replace(result, valid=result.code != "", solved=right, code="" if right else result.code, reason=reason)

    def task_file(self, seed: int) -> str:
        """The text of the task file of a seed."""
        return self.cell(seed).to_yaml() + ("unsolvable: true\n" if self.refusal else "")


def solvable(*builds: Build) -> tuple[Family, ...]:
    """Families of tasks with solutions, named and described by functions that build them."""
    return tuple(Family(build.__name__, _summary(build), build) for build in builds)


def refused(build: Build, *codes: Code, reason: str) -> Family:
    """A family of tasks without a solution; ``codes`` and ``reason`` as in :class:`Refusal`."""
    return Family(build.__name__, _summary(build), build, Refusal(frozenset(codes), reason))


def _summary(build: Build) -> str:
    return (build.__doc__ or "").strip().splitlines()[0]
