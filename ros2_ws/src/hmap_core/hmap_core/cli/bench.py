"""``hmap bench WHAT``: measurements, each in a module of its own."""

import argparse
from importlib.metadata import entry_points

from hmap_core.cli import (
    bench_cmgmp,
    bench_generality,
    bench_komo,
    bench_learning,
    bench_limits,
    bench_parts,
    bench_quality,
    bench_robustness,
    bench_startup,
    bench_table,
    bench_tasks,
)
from hmap_core.cli.main import add_kinds

ENTRY_POINTS = "hmap.benchmarks"  # group of other packages' modules with HELP, add_arguments and run
HELP = (
    "measure: tasks and generality (how often they are solved, how fast), table (methods against each other), "
    "robustness (in worlds that are off), learning (learned contacts against sampling), quality (of motions), "
    "komo (against RAI's), cmgmp (on its authors' demonstrations), limits, parts (object paths among many parts), "
    "startup, or graph (planning through the nodes)"
)
WHAT = {
    "cmgmp": bench_cmgmp,
    "generality": bench_generality,
    "komo": bench_komo,
    "learning": bench_learning,
    "limits": bench_limits,
    "parts": bench_parts,
    "quality": bench_quality,
    "robustness": bench_robustness,
    "startup": bench_startup,
    "table": bench_table,
    "tasks": bench_tasks,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the measurements as sub-commands."""
    others = {entry.name: entry.load() for entry in entry_points(group=ENTRY_POINTS)}
    add_kinds(parser, WHAT | others)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen measurement; the exit code."""
    return arguments.kind.run(arguments)
