"""Work that has to end by a deadline: what interrupts it for long, unless that is taken care of.

Compiled functions are loaded from Numba's cache at their first call, which takes up to LOADING each; and the garbage
collector would look through all that was imported.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

from hmap_core.deadline import check_time, give_cpu_time, until
from hmap_core.garbage import only_new_garbage

LOADING = 0.03  # s, to load a large function; most take less
_LOCKING = "numba:compiler_lock"  # Numba's event before it loads or compiles a function
_COMPILING = "numba:compile"


class _LookAtClock(event.Listener):
    """Raises PlannerError, TIME_LIMIT, where no time is left to load a function.

    What a function calls is loaded with it. Compiling, which takes much longer, is done before planning, and is not
    interrupted.
    """

    def on_start(self, event: event.Event) -> None:
        """Look at the clock before a function, and not within one."""
        if not global_compiler_lock.is_locked():
            check_time(LOADING)

    def on_end(self, event: event.Event) -> None:
        """The end of loading needs nothing."""


class _Compiling(event.Listener):
    """What is compiled after all, as nothing like it was planned before, is not counted as processor time."""

    def __init__(self):
        self._depth, self._began = 0, 0.0

    def on_start(self, event: event.Event) -> None:
        """A function begins to be compiled; those that it calls are compiled within."""
        if self._depth == 0:
            self._began = time.process_time()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """A function is compiled."""
        self._depth -= 1
        if self._depth == 0:
            give_cpu_time(time.process_time() - self._began)


@cache
def _watch_loading() -> None:
    event.register(_LOCKING, _LookAtClock())
    event.register(_COMPILING, _Compiling())


@contextmanager
def work_until(deadline: float) -> Iterator[None]:
    """Run a block with a deadline (:func:`hmap_core.deadline.until`) that loading code and garbage collection keep."""
    _watch_loading()
    with only_new_garbage(), until(deadline):
        yield
