"""How long the command takes to start: processor and wall time of new processes, with all caches on disk."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from statistics import median

from hmap_core.exceptions import ExecutionError

TASK = "bolt"
COMMANDS = (("--help",), ("tasks",), ("plan", TASK))
GRAPH = ("up", TASK, "--plan-only", "--no-picture")  # of the package hmap; measured until its nodes are ready
READY = "] up: "  # in the line of progress that says so
DECIMALS = 2


@dataclass(frozen=True)
class Start:
    """One run of a command.

    Attributes:
        cpu: s, user and system, of the process and those that it started, until all have ended.
        wall: s until it ended; of the graph, until its nodes are ready.
    """

    cpu: float
    wall: float


def commands() -> list[tuple[str, ...]]:
    """Arguments of the commands to measure; that of the graph only where its package is installed."""
    graph = any(entry.name == GRAPH[0] for entry in entry_points(group="hmap.commands"))
    return [*COMMANDS, *([GRAPH] if graph else [])]


def run(arguments: Sequence[str], repeats: int) -> list[Start]:
    """Runs a command in new processes, one after the other.

    Args:
        arguments: of ``hmap``.
        repeats: how often; one more run goes before, which fills the caches.

    Raises:
        ExecutionError: the command fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        return [_run_once(arguments, folder) for _ in range(repeats + 1)][1:]


def _run_once(arguments: Sequence[str], folder: str) -> Start:
    graph = tuple(arguments) == GRAPH
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "hmap_core", *arguments],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    ready, lines = None, []
    for line in process.stderr or ():
        lines.append(line)
        if graph and ready is None and READY in line:
            ready = time.monotonic() - began
            process.send_signal(signal.SIGINT)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0 or (graph and ready is None):
        raise ExecutionError(f"hmap {' '.join(arguments)} ended with {process.returncode}: {''.join(lines[-3:])}")
    return Start(usage.ru_utime + usage.ru_stime, ready if ready is not None else time.monotonic() - began)


def heading() -> str:
    """The first line of the table."""
    return f"{'command':<42}{'CPU':>10}{'wall':>10}"


def row(arguments: Sequence[str], starts: Sequence[Start]) -> str:
    """A line of the table: medians."""
    cpu, wall = median(start.cpu for start in starts), median(start.wall for start in starts)
    return f"{'hmap ' + ' '.join(arguments):<42}{cpu:>8.{DECIMALS}f} s{wall:>8.{DECIMALS}f} s"
