"""A table as Markdown, LaTeX, CSV and JSON."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

from hmap_core.evaluation.summary import markdown_table
from hmap_core.evaluation.table.statistics import CONFIDENCE, LEVEL, MIN_PAIRS, Cell, Comparison, success_interval
from hmap_core.evaluation.table.table import Table, label

COLUMNS = (
    "task",
    "method",
    "n",
    "claimed",
    "valid",
    "95 %",
    "executed",
    "median s",
    "p",
    "p Holm",
    "time ratio",
    "success",
)
CSV_COLUMNS = (
    "task", "method", "seed", "claimed", "valid", "executed", "solved", "time_s", "censored", "cpu_s", "time_limit_s",
    "code", "reason",
)  # fmt: skip
NOT_STATED = "cannot state the task"
LATEX_ESCAPES = str.maketrans({"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "*": r"$^*$"})


def markdown(table: Table, sessions: Sequence[dict[str, Any]], command: str) -> str:
    """The page: one table of methods by tasks, one of all numbers, and how they were made."""
    rows: list[tuple[str, ...]] = [COLUMNS]
    for task in table.tasks:
        rows += [_row(table, task, planner) for planner in table.planners]
    reference = label(table.reference)
    notes = [
        f"`p` is of McNemar's exact test of the paired success against `{reference}`; `p Holm` is corrected over the "
        f"tasks and counts below {LEVEL:g}. Intervals are Wilson's, at {CONFIDENCE:.0%}. The time ratio is the median "
        f"of the paired ratios to `{reference}`, with a bootstrap interval from {MIN_PAIRS} pairs on. Times of "
        "failures are censored at the time limit: `>` marks a median, `>=` and `<=` a ratio that is only a bound.",
        *_not_stated(table),
        *_provenance(sessions, command),
    ]
    return "\n".join([*markdown_table(matrix(table)), "", *markdown_table(rows), "", *notes]) + "\n"


def matrix(table: Table) -> list[tuple[str, ...]]:
    """Success of each method on each task, the heading first."""
    names = [table.cells[task, table.reference].task for task in table.tasks]
    rows = [("method", *names)]
    for planner in table.planners:
        rows.append((label(planner), *(_rate(table.cells[task, planner]) for task in table.tasks)))
    return rows


def _rate(cell: Cell) -> str:
    if not cell.stated:
        return NOT_STATED
    return f"{int(cell.success.sum())}/{len(cell.results)}"


def _row(table: Table, task: str, planner: str) -> tuple[str, ...]:
    cell, comparison = table.cells[task, planner], table.comparisons.get((task, planner))
    head = (cell.task, cell.planner, str(len(cell.results)))
    if not cell.stated:
        return (*head, *["-"] * (len(COLUMNS) - 4), NOT_STATED)
    low, high = success_interval(int(cell.success.sum()), len(cell.results))
    counts = (str(cell.claimed), str(cell.valid), f"{100 * low:.0f}-{100 * high:.0f}")
    median, bound = cell.median_time
    executed = "-" if cell.executed is None else str(cell.executed)
    return (*head, *counts, executed, f"{'> ' * bound}{median:.2f}", *_compared(comparison))


def _compared(comparison: Comparison | None) -> tuple[str, str, str, str]:
    if comparison is None:
        return "", "", "", "reference"
    p, corrected = (("-" if value is None else f"{value:.2g}") for value in (comparison.p, comparison.p_holm))
    return p, corrected, _ratio(comparison), comparison.verdict.value


def _ratio(comparison: Comparison) -> str:
    if comparison.ratio is None:
        return "-"
    if comparison.method_censored and comparison.reference_censored:
        bound = "~ "
    else:
        bound = ">= " * comparison.method_censored + "<= " * comparison.reference_censored
    if comparison.ratio_interval is None:
        return f"{bound}{comparison.ratio:.2g} (too few runs to tell)"
    low, high = comparison.ratio_interval
    return f"{bound}{comparison.ratio:.2g} ({low:.2g}-{high:.2g})"


def _not_stated(table: Table) -> list[str]:
    """Which methods cannot state which tasks, and why."""
    reasons = [
        f"- `{cell.planner}` on `{cell.task}`: {' '.join(cell.results[0].reason.split())}"
        for cell in table.cells.values()
        if not cell.stated
    ]
    return ["", f"Where it says *{NOT_STATED}*, the reason of the method:", "", *reasons] if reasons else []


def _provenance(sessions: Sequence[dict[str, Any]], command: str) -> list[str]:
    seconds = sum(session["seconds"] for session in sessions)
    machines = list(dict.fromkeys(f"{s['machine']}; {s['jobs']} jobs; Python {s['python']}" for s in sessions))
    versions = list(dict.fromkeys(", ".join(f"{k} {v}" for k, v in s["versions"].items()) for s in sessions))
    methods = list(dict.fromkeys(f"{label(k)} of {v}" for s in sessions for k, v in s["planners"].items()))
    return [
        "",
        f"`{command}` took {seconds:.0f} s in {len(sessions)} run{'s' * (len(sessions) != 1)}. Machine: "
        f"{' | '.join(machines)}. Versions: {' | '.join(versions)}. Methods: {', '.join(methods)}.",
    ]


def latex(table: Table) -> str:
    """The table of methods by tasks, with Wilson's interval in percent below each rate."""
    names = [table.cells[task, table.reference].task for task in table.tasks]
    lines = [
        rf"\begin{{tabular}}{{l{'c' * len(names)}}}",
        r"\hline",
        " & ".join(_escaped(text) for text in ("method", *names)) + r" \\",
        r"\hline",
    ]
    for planner in table.planners:
        cells = [table.cells[task, planner] for task in table.tasks]
        lines.append(" & ".join([_escaped(label(planner)), *map(_latex_cell, cells)]) + r" \\")
    return "\n".join([*lines, r"\hline", r"\end{tabular}"]) + "\n"


def _latex_cell(cell: Cell) -> str:
    if not cell.stated:
        return "--"
    low, high = success_interval(int(cell.success.sum()), len(cell.results))
    return rf"{_rate(cell)} [{100 * low:.0f}, {100 * high:.0f}]\,\%"


def _escaped(text: str) -> str:
    return text.translate(LATEX_ESCAPES)


def csv_text(table: Table) -> str:
    """One row for each trial; every statistic of the table follows from it."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for cell in table.cells.values():
        solved, times = cell.success, cell.times
        for k, (seed, result) in enumerate(zip(cell.seeds, cell.results, strict=True)):
            flags = (int(result.claimed), int(result.valid), int(result.solved) if cell.executes else "")
            cpu = "" if result.cpu_s is None else f"{result.cpu_s:.6f}"
            time = f"{times[k]:.6f}", int(not result.valid)
            reason = " ".join(result.reason.split())
            writer.writerow(
                (
                    cell.task,
                    cell.planner,
                    seed,
                    *flags,
                    int(solved[k]),
                    *time,
                    cpu,
                    cell.time_limit,
                    result.code,
                    reason,
                )
            )
    return stream.getvalue()


def json_text(table: Table, sessions: Sequence[dict[str, Any]], command: str) -> str:
    """Cells, comparisons and provenance."""
    document = {
        "command": command,
        "reference": label(table.reference),
        "sessions": list(sessions),
        "cells": [_cell_dict(cell) for cell in table.cells.values()],
        "comparisons": [_comparison_dict(comparison) for comparison in table.comparisons.values()],
    }
    return json.dumps(document, indent=2) + "\n"


def _cell_dict(cell: Cell) -> dict[str, Any]:
    successes, n = int(cell.success.sum()), len(cell.results)
    median, bound = cell.median_time
    return {
        "task": cell.task,
        "method": cell.planner,
        "stated": cell.stated,
        "n": n,
        "claimed": cell.claimed,
        "valid": cell.valid,
        "executed": cell.executed,
        "success_interval": success_interval(successes, n),
        "median_s": median,
        "median_is_bound": bound,
        "trials": [result.to_dict() for result in cell.results],
    }


def _comparison_dict(comparison: Comparison) -> dict[str, Any]:
    return {
        "task": comparison.task,
        "method": comparison.planner,
        "pairs": comparison.pairs,
        "only_method": comparison.only_method,
        "only_reference": comparison.only_reference,
        "p": comparison.p,
        "p_holm": comparison.p_holm,
        "time_ratio": comparison.ratio,
        "time_ratio_interval": comparison.ratio_interval,
        "verdict": comparison.verdict.value,
    }
