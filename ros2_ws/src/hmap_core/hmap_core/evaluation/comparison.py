"""Compares two sets of recorded runs: where they differ, by how much, and where there are too few runs to tell."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hmap_core.evaluation.intervals import difference_interval, permutation_p, smallest_p
from hmap_core.evaluation.recorded import COMPARED, RunMetrics, value
from hmap_core.evaluation.summary import aligned

ALPHA = 0.01  # a smaller p counts as a difference; so small since many numbers are compared
FEWEST = 5  # runs of each set
FEWEST_PAIRS = 8  # with which a p below ALPHA is possible
DIFFERS, SAME, TOO_FEW = "differs", "no difference found", "too few runs to tell"


@dataclass(frozen=True)
class Difference:
    """How one number differs between two sets.

    Attributes:
        name, unit: of the number.
        n_a, n_b: runs that have it; where paired, the pairs.
        paired: whether runs of the same task and seed are compared with each other.
        a, b: means.
        ratio: b / a; None where a is 0.
        low, high: 95 % interval of b - a.
        p: of a two-sided permutation test; None where there are too few runs.
        verdict: DIFFERS, SAME or TOO_FEW.
    """

    name: str
    unit: str
    n_a: int
    n_b: int
    paired: bool
    a: float
    b: float
    ratio: float | None
    low: float | None
    high: float | None
    p: float | None
    verdict: str

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return asdict(self)


def compare(a: Sequence[RunMetrics], b: Sequence[RunMetrics]) -> list[Difference]:
    """Where two sets of runs differ; numbers that one of them does not have are left out."""
    found = [_difference(name, unit, a, b) for name, unit in COMPARED.items()]
    return [difference for difference in found if difference is not None]


def remark(a: Sequence[RunMetrics], b: Sequence[RunMetrics]) -> str:
    """What would tell more, where seeds match but too few; empty: nothing."""
    both = len(_by_seed("solved", a).keys() & _by_seed("solved", b).keys())
    if not 0 < both < FEWEST_PAIRS:
        return ""
    return (
        f"the sets have {both} pair{'s' if both > 1 else ''} of the same task and seed; with {FEWEST_PAIRS}, runs are "
        "compared in pairs, which shows smaller differences"
    )


def _difference(name: str, unit: str, a: Sequence[RunMetrics], b: Sequence[RunMetrics]) -> Difference | None:
    first, second, paired = _values(name, a, b)
    if not len(first) or not len(second):
        return None
    means = float(first.mean()), float(second.mean())
    ratio = means[1] / means[0] if means[0] else None
    enough = min(len(first), len(second)) >= FEWEST and smallest_p(len(first), len(second), paired) < ALPHA
    if not enough:
        counts = len(first), len(second)
        return Difference(name, unit, *counts, paired, *means, ratio, None, None, None, TOO_FEW)
    p = permutation_p(first, second, paired)
    low, high = difference_interval(first, second, paired)
    verdict = DIFFERS if p < ALPHA else SAME
    return Difference(name, unit, len(first), len(second), paired, *means, ratio, low, high, p, verdict)


def _values(name: str, a: Sequence[RunMetrics], b: Sequence[RunMetrics]) -> tuple[np.ndarray, np.ndarray, bool]:
    """The values of both sets; of pairs with the same task and seed where there are enough."""
    one, other = _by_seed(name, a), _by_seed(name, b)
    both = sorted(one.keys() & other.keys())
    if len(both) >= FEWEST and smallest_p(len(both), len(both), True) < ALPHA:
        pairs = [(np.mean(one[key]), np.mean(other[key])) for key in both]
        return np.array([x for x, _ in pairs]), np.array([y for _, y in pairs]), True
    flat = [np.array([v for m in runs if (v := value(m, name)) is not None]) for runs in (a, b)]
    return flat[0], flat[1], False


def _by_seed(name: str, runs: Sequence[RunMetrics]) -> dict[tuple[str, int], list[float]]:
    found: dict[tuple[str, int], list[float]] = {}
    for metrics in runs:
        number = value(metrics, name)
        if metrics.seed is not None and number is not None:
            found.setdefault((metrics.task, metrics.seed), []).append(number)
    return found


def table(differences: Sequence[Difference]) -> list[str]:
    """One line for each number."""
    rows = [("", "A", "B", "B / A", "B - A, 95 %", "p", "n", "verdict")]
    for d in differences:
        ratio = "-" if d.ratio is None else f"{d.ratio:.3f}"
        between = "-" if d.low is None or d.high is None else f"{d.low:.3g} to {d.high:.3g}"
        count = f"{d.n_a} pairs" if d.paired else f"{d.n_a}, {d.n_b}"
        p = "-" if d.p is None else f"{d.p:.4f}"
        name = f"{d.name} {d.unit}".rstrip() if d.name.find(d.unit or "?") < 0 else d.name
        rows.append((name, f"{d.a:.4g}", f"{d.b:.4g}", ratio, between, p, count, d.verdict))
    return aligned(rows, (24, 11, 11, 9, 24, 9, 10, 23))
