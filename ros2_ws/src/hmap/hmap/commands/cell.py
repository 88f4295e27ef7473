"""``hmap cell CELL.yaml``: starts all nodes for a cell with real robots, whose drivers run already."""

import argparse
import signal
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from hmap.environment import prepare_process
from hmap.launcher.cell import Cell, composed, read_cell
from hmap.launcher.options import graph_arguments
from hmap.launcher.page import start_page
from hmap.launcher.processes import Graph, output_folder
from hmap_core.cli.main import positive
from hmap_core.command_line import keep_for_results
from hmap_core.compile_cache import ensure_compiled
from hmap_core.exceptions import Code, PlannerError

HELP = "start the nodes for a cell with real robots, look at everything before anything moves, and wait for goals"
RESTARTS = True  # see hmap_core.cli.main
START_LIMIT = 120.0  # s for the planners to be up
POLL = 0.1  # s
LISTEN = 2.0  # s
COMPOSED = "composed_planning"  # the process with supervisor and planners
YES, NO = 0, 1  # exit codes
BAG = "bag"  # folder of the bag in that of the run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("cell", type=Path, metavar="CELL", help="a cell file (.yaml), see docs/hardware.md")
    parser.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR", help="of the runs' folders (runs)")
    parser.add_argument("--dry-run", action="store_true", help="plan and show, and never move anything")
    scaling = "of planned speeds while robots move, in (0, 1] (1, or what the cell file says)"
    parser.add_argument("--speed-scaling", type=positive, metavar="X", help=scaling)
    graph_arguments(parser)
    parser.add_argument("--check", action="store_true", help="look at everything, and end; exit code 0 if all is well")


def run(arguments: argparse.Namespace) -> int:
    """Start the graph, look at it, and wait until Ctrl-C.

    Raises:
        InputError: the cell file cannot be used.
        PlannerError: the nodes do not start in time.
        ExecutionError: a node has died.
    """
    prepare_process()
    keep_for_results()
    from hmap_core.execution.pace import scale  # slow to import, as is the rest below
    from hmap_core.scenes import load_scene

    cell = read_cell(arguments.cell)
    if arguments.speed_scaling is not None:
        scale("--speed-scaling", arguments.speed_scaling)
    load_scene(cell.task, cell.seed)
    ensure_compiled(lambda text: print(text, file=sys.stderr))
    folder = output_folder(arguments.out, cell.task, cell.seed)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with Graph(folder / "logs") as graph:
        supervisor = {"dry_run": True} if arguments.dry_run else {}
        supervisor |= {} if arguments.speed_scaling is None else {"speed_scaling": arguments.speed_scaling}
        start(graph, cell, folder, supervisor, arguments.composed)
        _wait_until_up(graph, stop)
        if stop.is_set():
            return YES
        well = _look()
        if arguments.check:
            return YES if well else NO
        if not arguments.no_viewer:
            print(start_page(graph, arguments.port, cell.of("viewer"), cell.files), flush=True)
        print(f"the nodes run; their logs are in {folder / 'logs'}; Ctrl-C ends them", flush=True)
        while not stop.wait(POLL):
            for text in graph.news():
                print(text, file=sys.stderr, flush=True)
            graph.check()
    return YES


def start(
    graph: Graph, cell: Cell, folder: Path, supervisor: Mapping[str, object] | None = None, one_process: bool = False
) -> None:
    """Start the nodes of a cell.

    Args:
        graph: of them.
        cell: what the cell file says.
        folder: of the run, for the bag.
        supervisor: parameters of it that win over those of the cell file.
        one_process: whether supervisor and planners share one.
    """
    if cell.record:
        graph.start("recorder", cell.of("recorder", path=folder / BAG), cell.files)
    graph.start("perception", cell.of("perception"), cell.files)
    parameters = cell.of_planning(supervisor or {})
    if one_process:
        graph.start(COMPOSED, composed(parameters), cell.files)
        return
    for name, values in parameters.items():
        graph.start(name, values, cell.files)


def _wait_until_up(graph: Graph, stop: threading.Event) -> None:
    """Wait for all nodes but perception, which waits for the drivers."""
    from hmap.session import Session

    nodes = [name for name in graph.expected() if name != "perception"]
    with Session(name="hmap_cell") as session:
        until = time.monotonic() + START_LIMIT
        while len(up := session.ready(nodes)) < len(nodes) and not stop.wait(POLL):
            graph.check()
            if time.monotonic() > until:
                missing = ", ".join(name for name in nodes if name not in up)
                raise PlannerError(f"not up after {START_LIMIT:g} s: {missing}", Code.SERVICE_UNAVAILABLE)


def _look() -> bool:
    """Print what is wrong with the graph; whether a robot may move."""
    from hmap.commands.doctor import examine

    findings = examine(LISTEN)
    for finding in findings:
        if finding.level != "OK":
            print(f"{finding.level:<5}{finding.what}: {finding.text}")
    failed = sum(finding.level == "FAIL" for finding in findings)
    print(f"{len(findings)} things looked at: {failed} wrong", flush=True)
    return not failed
