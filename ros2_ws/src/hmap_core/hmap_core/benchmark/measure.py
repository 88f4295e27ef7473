"""Measurement of all solvers on the same instances, one after the other, in CPU time of one thread."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hmap_core.benchmark.registry import Problem, Side

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
WARM_UP_SEED = 10**6  # of an instance that is solved before the measurement: imports, caches
HIGH = 0.9  # the quantile reported in addition to the median


@dataclass
class Tally:
    """The results of one solver.

    Attributes:
        milliseconds: CPU time of each instance.
        verified: number of results reported as feasible that the judge confirms.
        false_accepts: results reported as feasible that the judge rejects, as (seed, errors).
    """

    milliseconds: list[float] = field(default_factory=list)
    verified: int = 0
    false_accepts: list[tuple[int, list[str]]] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Median CPU time, ms."""
        return float(np.median(self.milliseconds))

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {
            "median_ms": self.median,
            "p90_ms": float(np.quantile(self.milliseconds, HIGH)),
            "verified": self.verified,
            "false_accepts": len(self.false_accepts),
        }


@dataclass
class Result:
    """The results of the solvers for a problem with n instances; ``ompl`` only where the problem has that side."""

    n: int
    hmap: Tally = field(default_factory=Tally)
    rai: Tally = field(default_factory=Tally)
    ompl: Tally | None = None

    @property
    def ratio(self) -> float:
        """RAI's median time relative to hmap's."""
        return self.rai.median / self.hmap.median

    @property
    def ompl_ratio(self) -> float:
        """OMPL's median time relative to hmap's.

        Raises:
            ValueError: the problem has no side of OMPL.
        """
        if self.ompl is None:
            raise ValueError("the problem has no side of OMPL")
        return self.ompl.median / self.hmap.median

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        found = {"n": self.n, "hmap": self.hmap.to_dict(), "rai": self.rai.to_dict(), "ratio": self.ratio}
        if self.ompl is not None:
            found |= {"ompl": self.ompl.to_dict(), "ompl_ratio": self.ompl_ratio}
        return found


def one_thread() -> None:
    """Make numerical libraries that are loaded later use one thread."""
    for name in THREADS:
        os.environ[name] = "1"


def run(problem: Problem, n: int, progress: Callable[[int], None] = lambda k: None) -> Result:
    """Solve the instances 0 .. n - 1 of a problem with each solver.

    Args:
        problem: the problem.
        n: number of instances.
        progress: called with the number of finished instances.
    """
    result = Result(n, ompl=None if problem.ompl is None else Tally())
    sides = [(problem.hmap, result.hmap), (problem.rai, result.rai)]
    if problem.ompl is not None and result.ompl is not None:
        sides.append((problem.ompl, result.ompl))
    warm = problem.instance(WARM_UP_SEED)
    for side, _ in sides:
        side.solve(warm, side.prepare(warm))
    for seed in range(n):
        instance = problem.instance(seed)
        for side, tally in sides:
            solve(problem, side, tally, instance, seed)
        progress(seed + 1)
    return result


def solve(problem: Problem, side: Side, tally: Tally, instance, seed: int) -> None:
    """Solve one instance with one solver, measure and judge it, and add the result to the tally."""
    prepared = side.prepare(instance)
    before = time.process_time()
    answer = side.solve(instance, prepared)
    tally.milliseconds.append((time.process_time() - before) * 1e3)
    if not answer.claimed:
        return
    wrong = problem.judge(instance, answer.path)
    if wrong:
        tally.false_accepts.append((seed, wrong))
    else:
        tally.verified += 1
