"""``hmap robot WHAT``: what a robot is, and a first robot file for a URDF."""

import argparse

from hmap_core.cli import robot_check, robot_new
from hmap_core.cli.main import add_kinds

HELP = "check a robot file or a URDF, or write a first robot file for a URDF"
WHAT = {"check": robot_check, "new": robot_new}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands."""
    add_kinds(parser, WHAT)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen sub-command; the exit code."""
    return arguments.kind.run(arguments)
