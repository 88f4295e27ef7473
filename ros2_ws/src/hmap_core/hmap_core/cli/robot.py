"""``hmap robot WHAT``: what a robot is, and a first robot file for a URDF."""

import argparse

from hmap_core.cli import robot_check, robot_new

HELP = "check a robot file or a URDF, or write a first robot file for a URDF"
WHAT = {"check": robot_check, "new": robot_new}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands."""
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    for name, module in WHAT.items():
        kind = kinds.add_parser(name, help=module.HELP, description=module.HELP)
        kind.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show the trace of an error")
        module.add_arguments(kind)
        kind.set_defaults(action=module)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen sub-command; the exit code."""
    return arguments.action.run(arguments)
