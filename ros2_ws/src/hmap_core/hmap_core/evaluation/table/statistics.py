"""What the trials of a table show: intervals, paired tests, and where there are too few runs to tell.

The intervals and tests are scipy's: ``binomtest`` for Wilson's interval [1] and for McNemar's exact test [2], which is
the binomial test of the discordant pairs, and ``bootstrap`` [3]. Holm's correction [4] is not in scipy; it is a running
maximum of sorted p-values.

[1] Wilson, Probable inference, the law of succession, and statistical inference, 1927.
[2] McNemar, Note on the sampling error of the difference between correlated proportions or percentages, 1947.
[3] Efron and Tibshirani, An introduction to the bootstrap, 1993.
[4] Holm, A simple sequentially rejective multiple test procedure, 1979.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import binomtest, bootstrap

from hmap_core.evaluation.trial import TrialResult
from hmap_core.exceptions import Code

LEVEL = 0.05  # below which a corrected p-value counts
CONFIDENCE = 1.0 - LEVEL  # of all intervals
MIN_PAIRS = 6  # pairs from which on the exact test can get below LEVEL at all: 2 / 2^6
RESAMPLES = 2000
BOOTSTRAP_SEED = 0


class Verdict(StrEnum):
    """What a comparison of success says."""

    BETTER = "better"
    WORSE = "worse"
    NO_DIFFERENCE = "no difference shown"
    ALL_ALIKE = "alike in all runs"
    TOO_FEW = "too few runs to tell"


@dataclass(frozen=True)
class Cell:
    """One method on one task.

    Attributes:
        task, planner: names.
        seeds: of the trials, in their order.
        results: of the trials.
        executes: the task is executed under dynamics; a kinematic one is not.
        time_limit: s, at which the times of failures are censored.
    """

    task: str
    planner: str
    seeds: tuple[int, ...]
    results: tuple[TrialResult, ...]
    executes: bool
    time_limit: float

    @property
    def stated(self) -> bool:
        """Whether the method can state the task at all."""
        refused = {Code.UNKNOWN_TASK.name, Code.INVALID_INPUT.name}
        return not self.results or any(result.code not in refused for result in self.results)

    @property
    def claimed(self) -> int:
        """Trials in which the method returned a plan."""
        return sum(result.claimed for result in self.results)

    @property
    def valid(self) -> int:
        """Trials whose plan the judge accepts."""
        return sum(result.valid for result in self.results)

    @property
    def executed(self) -> int | None:
        """Trials whose execution solved the task; None for a task that is not executed."""
        return sum(result.solved for result in self.results) if self.executes else None

    @property
    def success(self) -> np.ndarray:
        """(n,) whether the task was solved: executed, or valid where nothing is executed."""
        return np.array([result.solved if self.executes else result.valid for result in self.results], bool)

    @property
    def times(self) -> np.ndarray:
        """(n,) time of the method until its valid plan, s; that of a failure is censored at the time limit."""
        return np.array([_time(result, self.time_limit) for result in self.results], float)

    @property
    def solved_in_time(self) -> np.ndarray:
        """(n,) whether a time is one, and not censored."""
        return np.array([result.valid for result in self.results], bool)

    @property
    def median_time(self) -> tuple[float, bool]:
        """Median time, s, and whether it is only a lower bound because failures are among what it depends on."""
        times = np.where(self.solved_in_time, self.times, np.inf)
        median = float(np.median(times)) if len(times) else np.inf
        return (self.time_limit, True) if np.isinf(median) else (median, False)


def _time(result: TrialResult, time_limit: float) -> float:
    return result.method_s if result.valid and result.method_s is not None else time_limit


def success_interval(successes: int, n: int) -> tuple[float, float]:
    """Wilson's interval of a success rate; (0, 1) where there are no trials."""
    if not n:
        return 0.0, 1.0
    interval = binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Comparison:
    """A method against the reference on one task, in the seeds that both have.

    Attributes:
        task, planner, reference: names.
        pairs: number of seeds.
        only_method, only_reference: discordant pairs: seeds that only one of them solved.
        p: of McNemar's exact test; None without pairs.
        p_holm: the same, corrected over the tasks.
        ratio: median of the paired ratios of the times, method / reference; None where there are no pairs.
        ratio_interval: its bootstrap interval; None where there are too few pairs.
        method_censored, reference_censored: whether times of failures are among those of the ratio.
    """

    task: str
    planner: str
    reference: str
    pairs: int
    only_method: int
    only_reference: int
    p: float | None
    p_holm: float | None = None
    ratio: float | None = None
    ratio_interval: tuple[float, float] | None = None
    method_censored: bool = False
    reference_censored: bool = False

    @property
    def verdict(self) -> Verdict:
        """What the corrected test of success says, and whether it could have said anything."""
        discordant = self.only_method + self.only_reference
        if self.p_holm is not None and self.p_holm < LEVEL:
            return Verdict.BETTER if self.only_method > self.only_reference else Verdict.WORSE
        if self.pairs < MIN_PAIRS or 0 < discordant < MIN_PAIRS:
            return Verdict.TOO_FEW
        return Verdict.NO_DIFFERENCE if discordant else Verdict.ALL_ALIKE


def compare(method: Cell, reference: Cell) -> Comparison:
    """Compare a method with the reference on their common task, seed by seed; without correction."""
    of_method = {seed: k for k, seed in enumerate(method.seeds)}
    common = [(of_method[seed], k) for k, seed in enumerate(reference.seeds) if seed in of_method]
    if not common or not (method.stated and reference.stated):
        return Comparison(method.task, method.planner, reference.planner, 0, 0, 0, None)
    a, b = np.array(common).T
    mine, theirs = method.success[a], reference.success[b]
    only_method, only_reference = int((mine & ~theirs).sum()), int((theirs & ~mine).sum())
    discordant = only_method + only_reference
    p = float(binomtest(only_method, discordant, 0.5).pvalue) if discordant else 1.0
    known = method.solved_in_time[a] | reference.solved_in_time[b]  # where both failed nothing is known of the ratio
    ratios = (method.times[a] / np.maximum(reference.times[b], 1e-9))[known]
    return Comparison(
        method.task,
        method.planner,
        reference.planner,
        len(common),
        only_method,
        only_reference,
        p,
        ratio=float(np.median(ratios)) if len(ratios) else None,
        ratio_interval=_ratio_interval(ratios),
        method_censored=bool((~method.solved_in_time[a][known]).any()),
        reference_censored=bool((~reference.solved_in_time[b][known]).any()),
    )


def _ratio_interval(ratios: np.ndarray) -> tuple[float, float] | None:
    """Percentile bootstrap interval of a median; None for fewer than MIN_PAIRS."""
    if len(ratios) < MIN_PAIRS:
        return None
    found = bootstrap(
        (ratios,),
        np.median,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(BOOTSTRAP_SEED),
    ).confidence_interval
    return float(found.low), float(found.high)


def holm(p: Sequence[float]) -> np.ndarray:
    """P-values (m,) corrected for m tests by Holm's step-down procedure."""
    values = np.asarray(p, float)
    order = np.argsort(values, kind="stable")
    stepped = np.maximum.accumulate((len(values) - np.arange(len(values))) * values[order])
    corrected = np.empty_like(values)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected
