"""``hmap bench startup``: how long the command takes to start."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from hmap_core.cli.main import count
from hmap_core.cli.plan import check_writable

HELP = "measure how long the command takes to start, a plan to be there in a new process, and the nodes to be up"
REPEATS = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--repeats", type=count, default=REPEATS, metavar="N", help=f"of each command ({REPEATS})")
    parser.add_argument("--no-graph", action="store_true", help="leave out the graph of nodes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure; the exit code."""
    if arguments.json is not None:
        check_writable(arguments.json)
    from hmap_core.benchmark import startup  # other commands need no benchmarks to be imported

    results = {}
    print(startup.heading(), flush=True)
    for command in startup.commands():
        if command == startup.GRAPH and arguments.no_graph:
            continue
        starts = startup.run(command, arguments.repeats)
        print(startup.row(command, starts), flush=True)
        results[" ".join(command)] = [asdict(start) for start in starts]
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0
