"""The deadline of the planning job that runs now: long steps look at it, however deep in the job they are.

Nothing but the time changes with it: a job that ends before its deadline has the same result as one without.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from hmap_core.exceptions import Code, PlannerError

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)


@contextmanager
def until(deadline: float) -> Iterator[None]:
    """Run a block with a deadline, ``time.monotonic()``; that of a block around it holds as well."""
    token = _DEADLINE.set(min(deadline, _DEADLINE.get()))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def deadline() -> float:
    """The deadline, ``time.monotonic()``; infinite outside of such a block."""
    return _DEADLINE.get()


def check_time() -> None:
    """Look at the clock.

    Raises:
        PlannerError: TIME_LIMIT; the deadline has passed.
    """
    if time.monotonic() > _DEADLINE.get():
        raise PlannerError("no time is left", Code.TIME_LIMIT)
