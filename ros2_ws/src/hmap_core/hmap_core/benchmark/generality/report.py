"""Report of ``hmap bench generality``: a row for each family, confidence intervals, and what failed and why."""

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from hmap_core.evaluation import summary
from hmap_core.evaluation.trial import TrialResult

Z = 1.959964  # quantile of the normal distribution for 95 % on both sides
ENDED = "ENDED"  # shown as the code of a trial whose process ended without a result
ALL = "all"
COLUMNS = ("family", *summary.COLUMNS[1:4], "95 %", *summary.COLUMNS[4:])
WIDTHS = (*summary.WIDTHS[:4], 10, *summary.WIDTHS[4:])
LONGEST = 200  # characters of a reason

Results = Mapping[str, Sequence[TrialResult]]  # family -> results of its trials


def wilson(solved: int, n: int) -> tuple[float, float]:
    """Wilson score interval of a success rate at 95 % (Wilson 1927, JASA 22:209).

    Args:
        solved: number of successes.
        n: number of trials, at least 1.

    Returns:
        Lower and upper bound, in [0, 1].
    """
    p, z2 = solved / n, Z**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def to_dict(results: Results) -> dict[str, Any]:
    """The document that ``hmap bench generality --json`` writes: statistics of each family and of all trials."""
    families = {name: _statistics(trials) for name, trials in results.items()}
    together = _statistics(_together(results))
    del together["trials"], together["failures"]
    return {"families": families, ALL: together}


def table(results: Results) -> list[str]:
    """The lines of the text table: the columns of ``hmap bench tasks``, and the interval in per cent."""
    return summary.aligned([COLUMNS, *_rows(results)], WIDTHS)


def failures(results: Results) -> list[str]:
    """Lines that say how often each family failed with which code, and why, one line for each kind of reason."""
    lines = []
    for name, trials in results.items():
        for failure in _failures(trials):
            seeds = ", ".join(map(str, failure["seeds"]))
            lines.append(f"{name}: {failure['code']}, seeds {seeds}: {failure['reason'][:LONGEST]}")
    return lines


def markdown(results: Results) -> list[str]:
    """The table and the failures in Markdown."""
    told = [f"- {line}" for line in failures(results)]
    return [*summary.markdown_table([COLUMNS, *_rows(results)]), "", *told]


def _rows(results: Results) -> list[tuple[str, ...]]:
    every = dict(results) | ({ALL: _together(results)} if len(results) > 1 else {})
    return [_row(name, trials) for name, trials in every.items()]


def _row(name: str, trials: Sequence[TrialResult]) -> tuple[str, ...]:
    cells = summary.cells(name, trials)
    low, high = wilson(sum(trial.solved for trial in trials), len(trials))
    return (*cells[:4], f"{100 * low:.0f}-{100 * high:.0f}", *cells[4:])


def _together(results: Results) -> list[TrialResult]:
    return [trial for trials in results.values() for trial in trials]


def _statistics(trials: Sequence[TrialResult]) -> dict[str, Any]:
    found = summary.TaskSummary(tuple(trials)).to_dict()
    interval = wilson(found["solved"], found["n"])
    return found | {"interval": list(interval), "failures": _failures(trials)}


def _failures(trials: Sequence[TrialResult]) -> list[dict[str, Any]]:
    """Code, number, seeds and first reason of each kind of failure; reasons that differ in numbers are one kind."""
    kinds: dict[tuple[str, str], list[TrialResult]] = defaultdict(list)
    for trial in trials:
        if not trial.solved:
            kinds[trial.code or ENDED, re.sub(r"[-\d.]+", "#", trial.reason)].append(trial)
    ordered = sorted(kinds.items(), key=lambda kind: -len(kind[1]))
    return [
        {"code": code, "n": len(same), "seeds": [trial.seed for trial in same], "reason": same[0].reason}
        for (code, _), same in ordered
    ]
