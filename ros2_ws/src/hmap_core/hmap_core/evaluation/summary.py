"""Summary of trials: statistics for each task, as a table and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.evaluation.trial import TrialResult

HIGH = 95  # percentile of planning times that is reported next to the median
COLUMNS = ("task", "n", "valid", "solved", "median s", "p95 s", "cpu s", "waypoints", "tries", "switches", "replans")
WIDTHS = (22, 5, 7, 8, 10, 9, 9, 11, 8, 10, 9)  # characters


@dataclass(frozen=True)
class TaskSummary:
    """Statistics of the trials of one task.

    Planning times, waypoints, tries and switches are of the trials with a valid plan.
    """

    trials: tuple[TrialResult, ...]

    @property
    def valid(self) -> int:
        """Number of trials with a valid plan."""
        return sum(trial.valid for trial in self.trials)

    @property
    def solved(self) -> int:
        """Number of solved trials."""
        return sum(trial.solved for trial in self.trials)

    @property
    def replans(self) -> int:
        """Number of replans in all trials."""
        return sum(trial.replans for trial in self.trials)

    @property
    def planning_times(self) -> list[float]:
        """Planning times of the trials with a valid plan, s."""
        return [trial.planning_s for trial in self.trials if trial.valid and trial.planning_s is not None]

    def percentile(self, key: str, percent: float) -> float | None:
        """Percentile of a number of the trials with a valid plan.

        Args:
            key: attribute of :class:`hmap_core.evaluation.trial.TrialResult`.
            percent: 0 to 100.

        Returns:
            The percentile; None if no such trial has the number.
        """
        values = [getattr(trial, key) for trial in self.trials if trial.valid and getattr(trial, key) is not None]
        return float(np.percentile(values, percent)) if values else None

    def _times(self, key: str) -> dict[str, float | None]:
        return {"median": self.percentile(key, 50), "p95": self.percentile(key, HIGH)}

    def to_dict(self) -> dict:
        """The statistics as plain JSON types; ``docs/results.md`` describes the keys."""
        return {
            "n": len(self.trials),
            "valid": self.valid,
            "solved": self.solved,
            "planning_s": self._times("planning_s"),
            "cpu_s": self._times("cpu_s"),
            "trials": [trial.to_dict() for trial in self.trials],
        }


def to_dict(results: Mapping[str, Sequence[TrialResult]]) -> dict:
    """The document that ``hmap bench tasks --json`` writes.

    Args:
        results: task -> results of its trials.
    """
    return {"tasks": {name: TaskSummary(tuple(trials)).to_dict() for name, trials in results.items()}}


def table(results: Mapping[str, Sequence[TrialResult]]) -> list[str]:
    """The results as an aligned text table: times in seconds (``cpu``: median), medians of counts, sum of replans.

    Args:
        results: task -> results of its trials.

    Returns:
        The lines.
    """
    return aligned([COLUMNS, *(cells(name, trials) for name, trials in results.items())], WIDTHS)


def aligned(rows: Sequence[Sequence[str]], widths: Sequence[int]) -> list[str]:
    """A text table.

    Args:
        rows: cells, the heading first.
        widths: smallest number of characters of the first column, and those of the others.

    Returns:
        The lines.
    """
    first = max(widths[0], *(len(row[0]) for row in rows))
    return [row[0].ljust(first) + "".join(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True)) for row in rows]


def markdown(results: Mapping[str, Sequence[TrialResult]]) -> list[str]:
    """The same table in Markdown.

    Args:
        results: task -> results of its trials.

    Returns:
        The lines.
    """
    return markdown_table([COLUMNS, *(cells(name, trials) for name, trials in results.items())])


def markdown_table(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table in Markdown, with numbers in all columns but the first; ``rows`` has the heading first."""
    return [_line(rows[0]), _line(("---",) + ("--:",) * (len(rows[0]) - 1)), *map(_line, rows[1:])]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def cells(name: str, trials: Sequence[TrialResult]) -> tuple[str, ...]:
    """The cells of a task's row, in the order of COLUMNS.

    Args:
        name: of the task.
        trials: results of its trials.
    """
    task = TaskSummary(tuple(trials))
    times = [
        _number(task.percentile(key, p), 2) for key, p in (("planning_s", 50), ("planning_s", HIGH), ("cpu_s", 50))
    ]
    counts = [_number(task.percentile(key, 50), 0) for key in ("waypoints", "contact_tries", "mode_switches")]
    return (name, str(len(task.trials)), str(task.valid), str(task.solved), *times, *counts, str(task.replans))


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
