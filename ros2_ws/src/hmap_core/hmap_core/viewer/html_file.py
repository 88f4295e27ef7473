"""A plan or a run as one HTML file that plays without a server and without a network."""

from html import escape
from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.viewer.column import Column
from hmap_core.viewer.recording import Recording
from hmap_core.viewer.search_html import search_html
from hmap_core.viewer.server import LOCALHOST, open_server

PERIOD = 0.04  # s between two pictures
MOST_LINES = 200  # of what is done when
MOST = 3000  # pictures; longer runs have fewer per second
PANEL = (
    "position: fixed; top: 8px; left: 8px; max-width: 34em; max-height: 70vh; overflow: auto; z-index: 1000; "
    "background: rgba(255,255,255,0.9); border-radius: 6px; padding: 6px 10px; font: 12px sans-serif;"
)


def write_html(recording: Recording, path: Path) -> None:
    """Write a recording as an HTML file, with viser's client inside.

    Args:
        recording: a plan, or a run.
        path: the file.

    Raises:
        InputError: the file cannot be written.
    """
    server = open_server(LOCALHOST, 0)
    try:
        column = Column(server, "/left", lambda text: None)
        column.set_visible("cameras", False)
        column.show(recording, 0.0)
        serializer = server.get_scene_serializer()
        times = np.linspace(0.0, recording.duration, min(MOST, max(2, round(recording.duration / PERIOD) + 1)))
        for before, t in zip(times[:-1], times[1:], strict=True):
            serializer.insert_sleep(float(t - before))
            column.show(recording, float(t))
        html = serializer.as_html()
    finally:
        server.stop()
    try:
        path.write_text(_with_panel(html, recording), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _with_panel(html: str, recording: Recording) -> str:
    """The page with what was tried and what is done when, beside the picture."""
    lines, last = [], ""
    for t, text in recording.captions:
        what = text.partition("  ")[2] or text
        if what != last and what.strip():
            lines.append(f"<div>{t:.1f} s: {escape(what)}</div>")
        last = what
    summary = f"<summary><b>{escape(recording.name)}</b>, {recording.duration:.1f} s</summary>"
    done = "".join(lines[:MOST_LINES])
    panel = f'<details style="{PANEL}" class="hmap-panel">{summary}{done}<h4>Algorithm 1</h4>'
    panel += f"{search_html(recording.search(0.0))}</details>"
    at = html.rindex("</body>")
    return html[:at] + panel + html[at:]
