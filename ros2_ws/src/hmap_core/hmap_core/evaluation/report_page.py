"""Pictures of recorded runs, and a report in HTML that needs no other file."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from hmap_core.evaluation.recorded import (
    COMPARED,
    CUT,
    FAILED,
    OF_WHOLE_RUNS,
    PLANNED,
    SOLVED,
    RunMetrics,
    intervals,
    remarks,
    rows,
    value,
)
from hmap_core.exceptions import InputError

WIDTH, HEIGHT = 6.0, 2.4  # inch
PER_RUN = 0.22  # inch of a picture's width for each run beyond MANY
MANY = 20  # runs
TEXT_COLUMNS = (1, 2, 4)  # of the table
COLORS = {SOLVED: "tab:blue", PLANNED: "tab:cyan", FAILED: "tab:red", CUT: "tab:orange"}
STYLE = """body{font:14px sans-serif;padding:1em 2em;max-width:110em}pre{overflow-x:auto}.scroll{overflow-x:auto}
table{border-collapse:collapse}
td,th{padding:.25em .5em;text-align:right;border-bottom:1px solid #ddd;white-space:nowrap}
.text{text-align:left}.solved{color:#1f77b4}.planned{color:#17a2b8}.failed{color:#d62728;font-weight:bold}
.cut{color:#c65d00;font-weight:bold}.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(30em,1fr));gap:1em}
.caption{font-weight:bold}img{max-width:100%}"""
MEANING = {  # of the numbers that are drawn
    "phases": "s of real time in each phase",
    "planning_s": "real time of the first plan",
    "execution_s": "robots' clock, from the first motion to the end",
    "moving_s": "while a joint moves",
    "joint_path_rad": "length of the joint paths of all robots",
    "tip_path_m": "length of the end-effectors' paths",
    "jerk_rad_s3": "root mean square while joints move",
    "clearance_m": "smallest distance of what does not touch by the plan's design",
    "contact_switches": "contacts that were begun",
    "replans": "new plans that were asked for",
    "replan_latency_s": "from there until they are executed, mean",
    "drift_joints_rad": "joints off the plan, at most",
    "drift_object_m": "object off the plan, at most",
    "goal_error_m": "object off its goal at the end",
}
COLUMNS = (
    "plan: real time of the first plan; exec: the robots' clock from the first motion to the end; path: joints of all "
    "robots; clear: smallest distance, by the judge; drift: object off the plan, at most; goal: object off its goal at "
    "the end; -: not known."
)


def plots(metrics: Sequence[RunMetrics]) -> dict[str, bytes]:
    """Name -> PNG: the phases of all runs, and each number that some run has; runs by their numbers in the table."""
    found = {"phases": _phases(metrics)} if any(m.phases for m in metrics) else {}
    for name, unit in COMPARED.items():
        points = [(k, m.outcome, v) for k, m in enumerate(metrics, 1) if (v := _drawn(m, name)) is not None]
        if not points or name == "solved":  # the colors tell
            continue
        figure, axes = _axes(metrics, f"{name} {'' if unit and name.endswith(_suffix(unit)) else unit}".rstrip())
        for outcome, color in COLORS.items():
            of_outcome = [(k, v) for k, ended, v in points if ended == outcome]
            if of_outcome:
                axes.bar([k for k, _ in of_outcome], [v for _, v in of_outcome], color=color, label=outcome)
        if not any(v for _, _, v in points):
            axes.set_ylim(0.0, 1.0)
        if len({ended for _, ended, _ in points}) > 1:
            figure.legend(loc="outside right upper", fontsize=8)
        found[name] = _png(figure)
    return found


def save_plots(metrics: Sequence[RunMetrics], folder: Path) -> list[Path]:
    """Write the pictures into a folder.

    Raises:
        InputError: it cannot be written.
    """
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in plots(metrics).items():
            path = folder / f"{name}.png"
            path.write_bytes(picture)
            written.append(path)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error}") from error
    return written


def save(metrics: Sequence[RunMetrics], problems: Sequence[str], path: Path) -> None:
    """Write the report.

    Raises:
        InputError: it cannot be written.
    """
    told = [*remarks(metrics), *problems]
    parts = [
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>hmap evaluate</title><style>{STYLE}</style>",
        f"<h1>{len(metrics)} recorded run{'' if len(metrics) == 1 else 's'}</h1>",
        f"<div class='scroll'>{_table(metrics)}</div><p>{html.escape(COLUMNS)}</p>" if metrics else "",
        "<h2>Means and 95 % intervals</h2>" + _block("\n".join(intervals(metrics))) if metrics else "",
        "<h2>Faults and what is missing</h2><ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in told) + "</ul>"
        if told
        else "",
        "<h2>Run by run</h2><div class='plots'>" if metrics else "",
    ]
    for name, picture in plots(metrics).items():
        data = base64.b64encode(picture).decode()
        caption = f"<figcaption>{html.escape(name)}</figcaption>{html.escape(MEANING[name])}"
        parts.append(
            f"<figure>{caption}<br><img alt='{html.escape(name)}' src='data:image/png;base64,{data}'></figure>"
        )
    parts.append("</div>" if metrics else "")
    try:
        path.write_text("\n".join(parts), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def _drawn(metrics: RunMetrics, name: str) -> float | None:
    """A number of one run as it is drawn: also of runs that did not come to their end, in their color."""
    if name in OF_WHOLE_RUNS:
        found = getattr(metrics, name)
        return None if found is None else float(found)
    return value(metrics, name)


def _table(metrics: Sequence[RunMetrics]) -> str:
    """The runs as an HTML table; the tool tip of a name is the path of its bag."""
    head, *body = rows(metrics)
    cells = [_cell("th", k, text, "") for k, text in enumerate(head)]
    lines = [f"<tr>{''.join(cells)}</tr>"]
    for m, row in zip(metrics, body, strict=True):
        cells = [
            _cell("td", k, text, f" title='{html.escape(m.bag, quote=True)}'" if k == 1 else "", m.outcome.split()[0])
            for k, text in enumerate(row)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{''.join(lines)}</table>"


def _cell(kind: str, column: int, text: str, more: str, outcome: str = "") -> str:
    names = ["text"] if column in TEXT_COLUMNS else []
    names += [outcome] if outcome and column == TEXT_COLUMNS[-1] else []
    style = f" class='{' '.join(names)}'" if names else ""
    return f"<{kind}{style}{more}>{html.escape(text)}</{kind}>"


def _phases(metrics: Sequence[RunMetrics]) -> bytes:
    """Seconds of real time that each run spent in each phase, on top of each other."""
    names = list(dict.fromkeys(phase for m in metrics for phase in m.phases))
    figure, axes = _axes(metrics, "s")
    bottom = [0.0] * len(metrics)
    for k, name in enumerate(names):
        heights = [m.phases.get(name, 0.0) for m in metrics]
        axes.bar(range(1, len(metrics) + 1), heights, bottom=bottom, label=name, color=f"C{k}")
        bottom = [b + h for b, h in zip(bottom, heights, strict=True)]
    figure.legend(loc="outside right upper", fontsize=8)
    return _png(figure)


def _axes(metrics: Sequence[RunMetrics], label: str):
    """A figure whose horizontal axis has the runs."""
    figure = Figure(figsize=(WIDTH + PER_RUN * max(0, len(metrics) - MANY), HEIGHT), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel="run", ylabel=label, xlim=(0.4, len(metrics) + 0.6))
    axes.set_xticks(range(1, len(metrics) + 1))
    axes.tick_params(axis="x", labelsize=8)
    return figure, axes


def _suffix(unit: str) -> str:
    """How the names of numbers end that have a unit."""
    return "_" + unit.replace("/", "_").replace("^", "")


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _block(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"
