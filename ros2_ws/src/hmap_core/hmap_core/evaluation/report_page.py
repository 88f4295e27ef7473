"""Pictures of recorded runs, and a report in HTML that needs no other file."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from hmap_core.evaluation.recorded import COMPARED, RunMetrics, intervals, table, value
from hmap_core.exceptions import InputError

SIZE = (8.0, 2.6)  # inch
STYLE = "body{font:14px sans-serif;padding:2em}pre{overflow-x:auto}img{max-width:100%}"


def plots(metrics: Sequence[RunMetrics]) -> dict[str, bytes]:
    """Name -> PNG: the phases of all runs, and each number that some run has."""
    found = {"phases": _phases(metrics)} if any(m.phases for m in metrics) else {}
    for name, unit in COMPARED.items():
        points = [(k, v) for k, m in enumerate(metrics, 1) if (v := value(m, name)) is not None]
        if points:
            figure = Figure(figsize=SIZE, layout="constrained")
            axes = figure.subplots()
            axes.bar([k for k, _ in points], [v for _, v in points], color="tab:blue")
            axes.set(xlabel="run", ylabel=f"{name} {unit}".rstrip(), xlim=(0.4, len(metrics) + 0.6))
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
    faults = [f"{m.bag} #{m.goal}: {text}" for m in metrics for text in (*m.faults, *m.missing)]
    parts = [
        f"<!doctype html><meta charset='utf-8'><title>hmap evaluate</title><style>{STYLE}</style>",
        f"<h1>{len(metrics)} recorded runs</h1>",
        _block("\n".join(table(metrics))),
        "<h2>Means and 95 % intervals</h2>" + _block("\n".join(intervals(metrics))) if metrics else "",
        "<h2>Faults and what is missing</h2>" + _block("\n".join([*faults, *problems])) if faults or problems else "",
    ]
    for name, picture in plots(metrics).items():
        data = base64.b64encode(picture).decode()
        parts.append(f"<h2>{html.escape(name)}</h2><img alt='{html.escape(name)}' src='data:image/png;base64,{data}'>")
    try:
        path.write_text("\n".join(parts), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def _phases(metrics: Sequence[RunMetrics]) -> bytes:
    """Seconds of real time that each run spent in each phase, on top of each other."""
    names = list(dict.fromkeys(phase for m in metrics for phase in m.phases))
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    bottom = [0.0] * len(metrics)
    for name in names:
        heights = [m.phases.get(name, 0.0) for m in metrics]
        axes.bar(range(1, len(metrics) + 1), heights, bottom=bottom, label=name)
        bottom = [b + h for b, h in zip(bottom, heights, strict=True)]
    axes.set(xlabel="run", ylabel="phases s")
    axes.legend(fontsize=7, ncols=2)
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _block(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"
