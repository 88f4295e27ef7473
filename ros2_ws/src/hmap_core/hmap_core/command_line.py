"""What all commands have in common: exit codes, errors as one line, and standard output that belongs to the results.

PyBullet and other libraries write messages to file descriptor 1 from C, past ``sys.stdout``, and some only when the
process ends. They would be in the middle of JSON or YAML.
"""

import os
import sys
import traceback
from collections.abc import Callable
from typing import TextIO

from hmap_core.exceptions import HmapError, InputError

YES, NO, BAD_INPUT = 0, 1, 2  # exit codes
_KEPT: list[TextIO] = []  # what sys.stdout is for results


def run_reported(run: Callable[[], int], name: str, debug: bool | None = None) -> int:
    """Runs a command, and reports errors as one line on standard error.

    Args:
        run: the command; returns its exit code.
        name: of the command, with which the line starts.
        debug: show the trace of an error, too; None if the command has no such option.

    Returns:
        The exit code.
    """
    try:
        code = run()
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of the results has ended, as with `hmap tasks | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NO
    except KeyboardInterrupt:
        return _fail("interrupted", NO, name, debug)
    except InputError as error:
        return _fail(error, BAD_INPUT, name, debug)
    except HmapError as error:
        return _fail(error, NO, name, debug)
    except Exception as error:
        advice = " (--debug shows where)" if debug is False else ""
        return _fail(f"[internal/INTERNAL] {type(error).__name__}: {error}{advice}", NO, name, debug)


def _fail(problem: object, code: int, name: str, debug: bool | None) -> int:
    if debug:
        traceback.print_exc()
    print(f"{name}: " + " ".join(str(problem).split()), file=sys.stderr)
    return code


def keep_for_results() -> None:
    """Sends what libraries write to file descriptor 1 to standard error, until the process ends.

    What Python prints to ``sys.stdout`` still goes to standard output. Nothing happens if ``sys.stdout`` is not that of
    the process, such as in tests that capture it, or when called again.
    """
    stream: TextIO = sys.stdout
    try:
        if sys.__stdout__ is None or sys.__stderr__ is None or stream is not sys.__stdout__ or stream.fileno() != 1:
            return
        stream.flush()
        own = os.dup(1)
        os.dup2(sys.__stderr__.fileno(), 1)
    except (OSError, ValueError):  # closed, or no file
        return
    buffering = 1 if os.isatty(own) else -1
    sys.stdout = os.fdopen(own, "w", buffering, encoding=stream.encoding, errors=stream.errors)
    _KEPT.append(sys.stdout)


def leave_results() -> None:
    """Undoes :func:`keep_for_results` in a forked process, whose standard output is another one from now on."""
    while _KEPT:
        _KEPT.pop().close()
        sys.stdout = sys.__stdout__
