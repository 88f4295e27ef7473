"""Report of ``hmap bench robustness``: how often each task is solved in open and in closed loop, with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

from hmap_core.benchmark.generality.report import wilson
from hmap_core.evaluation.summary import aligned, markdown_table
from hmap_core.evaluation.trial import Trial, TrialResult

ALL = "all"
COLUMNS = ("task", "n", "valid", "open loop", "%", "95 %", "closed loop", "%", "95 %", "new plans")
WIDTHS = (16, 5, 7, 11, 6, 9, 13, 6, 9, 11)  # characters
LONGEST = 160  # characters of a reason


@dataclass(frozen=True)
class Row:
    """The results of one task, or of all.

    Attributes:
        name: of the task.
        open_loop, closed_loop: the results without and with new plans, for the same worlds.
    """

    name: str
    open_loop: tuple[TrialResult, ...]
    closed_loop: tuple[TrialResult, ...]


def rows(trials: Sequence[Trial], results: Sequence[TrialResult]) -> list[Row]:
    """The results by task, and of all tasks together; trials without new plans are open loop."""
    names = list(dict.fromkeys(trial.name for trial in trials))
    pairs = list(zip(trials, results, strict=True))
    found = [
        Row(
            name,
            tuple(result for trial, result in pairs if trial.name == name and not trial.max_replans),
            tuple(result for trial, result in pairs if trial.name == name and trial.max_replans),
        )
        for name in names
    ]
    together = [tuple(r for row in found for r in each(row)) for each in (_open, _closed)]
    return [*found, Row(ALL, *together)]


def _open(row: Row) -> tuple[TrialResult, ...]:
    return row.open_loop


def _closed(row: Row) -> tuple[TrialResult, ...]:
    return row.closed_loop


def table(found: Sequence[Row]) -> list[str]:
    """The lines of an aligned text table."""
    return aligned([COLUMNS, *map(_cells, found)], WIDTHS)


def markdown(found: Sequence[Row]) -> list[str]:
    """The same table in Markdown."""
    return markdown_table([COLUMNS, *map(_cells, found)])


def to_dict(found: Sequence[Row]) -> dict:
    """The results as plain JSON types: task -> ``open_loop`` and ``closed_loop``."""
    return {row.name: {"open_loop": _rate(row.open_loop), "closed_loop": _rate(row.closed_loop)} for row in found}


def failures(trials: Sequence[Trial], results: Sequence[TrialResult]) -> list[str]:
    """A line for each trial that was not solved: task, seed, mode and reason."""
    lines = []
    for trial, result in zip(trials, results, strict=True):
        if not result.solved:
            mode = "closed loop" if trial.max_replans else "open loop"
            lines.append(f"{trial.name}, seed {trial.seed}, world {trial.sample}, {mode}: {result.reason[:LONGEST]}")
    return lines


def _rate(trials: Sequence[TrialResult]) -> dict:
    solved = sum(trial.solved for trial in trials)
    low, high = wilson(solved, len(trials)) if trials else (0.0, 1.0)
    return {"n": len(trials), "solved": solved, "interval_95": [low, high], "trials": [t.to_dict() for t in trials]}


def _cells(row: Row) -> tuple[str, ...]:
    shares = []
    for trials in (row.open_loop, row.closed_loop):
        rate = _rate(trials)
        low, high = (100.0 * bound for bound in rate["interval_95"])
        percent = 100.0 * rate["solved"] / max(1, rate["n"])
        shares += [str(rate["solved"]), f"{percent:.0f}", f"{low:.0f}-{high:.0f}"]
    valid = sum(trial.valid for trial in row.closed_loop)
    replans = sum(trial.replans for trial in row.closed_loop)
    return (row.name, str(len(row.closed_loop)), str(valid), *shares, str(replans))
