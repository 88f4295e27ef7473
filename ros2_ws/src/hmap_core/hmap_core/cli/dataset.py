"""``hmap dataset WHAT``: makes and checks a data set of labelled contacts."""

import argparse

from hmap_core.cli import dataset_check, dataset_make
from hmap_core.cli.main import add_kinds

HELP = "make or check a data set of labelled contacts in generated scenes (see docs/learning.md)"
WHAT = {"check": dataset_check, "make": dataset_make}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands."""
    add_kinds(parser, WHAT)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen sub-command; the exit code."""
    return arguments.kind.run(arguments)
