"""The results of trials put together: numbers for each task, as a table and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.evaluation.trial import TrialResult

HIGH = 95  # the percentile of planning times that is told beside the median
COLUMNS = ("task", "n", "valid", "solved", "median s", "p95 s", "cpu s", "waypoints", "tries", "switches", "replans")
WIDTHS = (22, 5, 7, 8, 10, 9, 9, 11, 8, 10, 9)  # characters


@dataclass(frozen=True)
class TaskSummary:
    """The trials of one task.

    Planning times, waypoints, tries and switches are of the trials whose plan is valid.
    """

    trials: tuple[TrialResult, ...]

    @property
    def valid(self) -> int:
        return sum(trial.valid for trial in self.trials)

    @property
    def solved(self) -> int:
        return sum(trial.solved for trial in self.trials)

    @property
    def replans(self) -> int:
        """New plans in all trials together."""
        return sum(trial.replans for trial in self.trials)

    @property
    def planning_times(self) -> list[float]:
        """Seconds, of the trials whose plan is valid."""
        return [trial.planning_s for trial in self.trials if trial.valid]

    def percentile(self, key: str, percent: float) -> float | None:
        """A percentile of one of the numbers of the trials whose plan is valid; None where there is none."""
        values = [getattr(trial, key) for trial in self.trials if trial.valid and getattr(trial, key) is not None]
        return float(np.percentile(values, percent)) if values else None

    def _times(self, key: str) -> dict[str, float | None]:
        return {"median": self.percentile(key, 50), "p95": self.percentile(key, HIGH)}

    def to_dict(self) -> dict:
        """Plain data for JSON; ``docs/results.md`` describes it."""
        return {
            "n": len(self.trials),
            "valid": self.valid,
            "solved": self.solved,
            "planning_s": self._times("planning_s"),
            "cpu_s": self._times("cpu_s"),
            "trials": [trial.to_dict() for trial in self.trials],
        }


def to_dict(results: dict[str, Sequence[TrialResult]]) -> dict:
    """The document that ``hmap bench tasks --json`` writes, from the results of each task."""
    return {"tasks": {name: TaskSummary(tuple(trials)).to_dict() for name, trials in results.items()}}


def table(results: dict[str, Sequence[TrialResult]]) -> list[str]:
    """Lines for people: times in seconds (``cpu``: the median), the median of the counts, the sum of new plans."""
    rows = [COLUMNS, *(_row(name, TaskSummary(tuple(trials))) for name, trials in results.items())]
    first = max(WIDTHS[0], *(len(row[0]) for row in rows))
    return [row[0].ljust(first) + "".join(c.rjust(w) for c, w in zip(row[1:], WIDTHS[1:], strict=True)) for row in rows]


def markdown(results: dict[str, Sequence[TrialResult]]) -> list[str]:
    """The same as a table in Markdown."""
    rows = [_row(name, TaskSummary(tuple(trials))) for name, trials in results.items()]
    return [_line(COLUMNS), _line(("---",) + ("--:",) * (len(COLUMNS) - 1)), *map(_line, rows)]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _row(name: str, task: TaskSummary) -> tuple[str, ...]:
    times = [
        _number(task.percentile(key, p), 2) for key, p in (("planning_s", 50), ("planning_s", HIGH), ("cpu_s", 50))
    ]
    counts = [_number(task.percentile(key, 50), 0) for key in ("waypoints", "contact_tries", "mode_switches")]
    return (name, str(len(task.trials)), str(task.valid), str(task.solved), *times, *counts, str(task.replans))


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
