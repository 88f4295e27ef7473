"""Finds the sub-command, parses the arguments, and turns errors into one line and an exit code."""

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import entry_points
from types import ModuleType

from hmap_core.exceptions import HmapError, InputError
from hmap_core.garbage import collect_rarely

ENTRY_POINTS = "hmap.commands"  # group of other packages' modules with HELP, add_arguments and run
COMMANDS = ("tasks", "plan", "check", "execute", "bench", "plugins", "robot")
BUILT_IN = {name: f"hmap_core.cli.{name}" for name in COMMANDS}
YES, NO, BAD_INPUT = 0, 1, 2  # exit codes


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``hmap``.

    Args:
        argv: arguments; default: those of the process.

    Returns:
        The exit code.
    """
    collect_rarely()
    arguments = _parse(sys.argv[1:] if argv is None else list(argv))
    try:
        code = arguments.module.run(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of the results has ended, as with `hmap tasks | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NO
    except KeyboardInterrupt:
        return _fail("interrupted", NO, arguments.debug)
    except InputError as error:
        return _fail(error, BAD_INPUT, arguments.debug)
    except HmapError as error:
        return _fail(error, NO, arguments.debug)
    except Exception as error:
        advice = "" if arguments.debug else " (--debug shows where)"
        return _fail(f"[internal/INTERNAL] {type(error).__name__}: {error}{advice}", NO, arguments.debug)


def _fail(problem: object, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    print("hmap: " + " ".join(str(problem).split()), file=sys.stderr)
    return code


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


Command = ModuleType  # HELP: str; add_arguments(parser) -> None; run(arguments) -> int
