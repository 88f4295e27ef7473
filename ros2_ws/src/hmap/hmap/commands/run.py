"""``hmap run NODE``: runs one node in the foreground, as ``ros2 run hmap NODE`` does."""

import argparse
import os
from importlib import import_module
from pkgutil import iter_modules

from hmap.environment import ros_environment
from hmap.launcher.processes import node_command
from hmap_core.exceptions import InputError

HELP = "run one node in the foreground"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("node", metavar="NODE", help=", ".join(nodes()))
    parser.add_argument("rest", nargs=argparse.REMAINDER, metavar="...", help="for ROS: --ros-args -p task:=tunnel")


def run(arguments: argparse.Namespace) -> int:
    """Replace this process by the node's.

    Raises:
        InputError: the node is unknown.
    """
    if arguments.node not in nodes():
        raise InputError(f"unknown node {arguments.node!r}; known: {', '.join(nodes())}")
    command = [*node_command(arguments.node), *arguments.rest]
    os.execve(command[0], command, ros_environment())


def nodes() -> list[str]:
    """The names of the nodes."""
    return sorted(module.name for module in iter_modules(import_module("hmap.nodes").__path__))
