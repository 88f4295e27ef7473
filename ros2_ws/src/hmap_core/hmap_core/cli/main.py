"""Finds the sub-command and parses the arguments."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.metadata import entry_points
from types import ModuleType

from hmap_core.command_line import keep_for_results, run_reported
from hmap_core.garbage import collect_rarely

ENTRY_POINTS = "hmap.commands"  # group of other packages' modules with HELP, add_arguments and run
COMMANDS = (
    "tasks",
    "plan",
    "check",
    "execute",
    "bench",
    "plugins",
    "robot",
    "view",
    "dataset",
    "train",
    "evaluate-proposer",
)
BUILT_IN = {name: f"hmap_core.cli.{name.replace('-', '_')}" for name in COMMANDS}


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``hmap``.

    Args:
        argv: arguments; default: those of the process.

    Returns:
        The exit code.
    """
    collect_rarely()
    arguments = _parse(sys.argv[1:] if argv is None else list(argv))
    if not getattr(arguments.module, "RESTARTS", False):
        keep_for_results()
    return run_reported(lambda: arguments.module.run(arguments), "hmap", arguments.debug)


def _parse(argv: list[str]) -> argparse.Namespace:
    modules = _module_names()
    chosen = next((word for word in argv if not word.startswith("-")), None)
    parser = argparse.ArgumentParser(
        "hmap", description="Plans and executes manipulation: the object first, then hands."
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    # only the chosen command is imported, so that it starts fast
    for name in [chosen] if chosen in modules else sorted(modules):
        module = import_module(modules[name])
        command = commands.add_parser(name, help=module.HELP, description=module.HELP)
        command.add_argument("--debug", action="store_true", help="show the trace of an error")
        module.add_arguments(command)
        command.set_defaults(module=module)
    return parser.parse_args(argv)


def _module_names() -> dict[str, str]:
    return BUILT_IN | {entry.name: entry.value for entry in entry_points(group=ENTRY_POINTS)}


def add_kinds(parser: argparse.ArgumentParser, modules: Mapping[str, ModuleType]) -> None:
    """Add a sub-command for each module, which has HELP, add_arguments and run; the chosen one is ``kind``."""
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    for name, module in modules.items():
        kind = kinds.add_parser(name, help=module.HELP, description=module.HELP)
        # the option is allowed after WHAT, too; without it, the value given before WHAT is kept
        kind.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help="show the trace of an error")
        module.add_arguments(kind)
        kind.set_defaults(kind=module)


def seed_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--seed``, the same in every command."""
    parser.add_argument("--seed", type=natural, default=0, metavar="S", help="of the randomisation, 0 or larger (0)")


def natural(text: str) -> int:
    """Parse an integer that is at least 0.

    Raises:
        ArgumentTypeError: it is negative.
        ValueError: it is no integer.
    """
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; 0 or larger is allowed")
    return value


def count(text: str) -> int:
    """Parse an integer that is at least 1.

    Raises:
        ArgumentTypeError: it is less than 1.
        ValueError: it is no integer.
    """
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not 1 or larger")
    return value


def port_number(text: str) -> int:
    """Parse the number of a TCP port.

    Raises:
        ArgumentTypeError: it is not from 0 to 65535.
        ValueError: it is no integer.
    """
    value = int(text)
    if not 0 <= value < 2**16:
        raise argparse.ArgumentTypeError(f"{text} is no port; 0 (any free one) to 65535 is allowed")
    return value


def positive(text: str) -> float:
    """Parse a finite number above 0.

    Raises:
        ArgumentTypeError: it is not finite or not above 0.
        ValueError: it is no number.
    """
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number above 0")
    return value


def zero_or_more(text: str) -> float:
    """Parse a finite number that is at least 0.

    Raises:
        ArgumentTypeError: it is negative or not finite.
        ValueError: it is no number.
    """
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number, 0 or larger")
    return value


# HELP: str; add_arguments(parser) -> None; run(arguments) -> int. A module with RESTARTS = True starts the process
# anew, and calls keep_for_results() after that by itself.
Command = ModuleType
