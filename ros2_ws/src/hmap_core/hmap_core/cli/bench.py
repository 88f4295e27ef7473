"""``hmap bench WHAT``: measurements, each in a module of its own."""

import argparse

from hmap_core.cli import bench_generality, bench_komo, bench_limits, bench_parts, bench_startup, bench_tasks

HELP = (
    "measure: tasks and generality (how often they are solved, how fast), komo (against RAI's), limits, "
    "parts (object paths among many parts) or startup"
)
WHAT = {
    "generality": bench_generality,
    "komo": bench_komo,
    "limits": bench_limits,
    "parts": bench_parts,
    "startup": bench_startup,
    "tasks": bench_tasks,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the measurements as sub-commands."""
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    for name, module in WHAT.items():
        kind = kinds.add_parser(name, help=module.HELP, description=module.HELP)
        # the option is allowed after WHAT, too; without it, the value given before WHAT is kept
        kind.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show the trace of an error")
        module.add_arguments(kind)
        kind.set_defaults(measurement=module)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen measurement; the exit code."""
    return arguments.measurement.run(arguments)
