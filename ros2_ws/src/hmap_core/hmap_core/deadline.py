"""The deadline of the planning job that runs now: long steps look at it, however deep in the job they are.

Nothing but the time changes with it: a job that ends before its deadline has the same result as one without.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from hmap_core.exceptions import Code, PlannerError

# share of a time limit, and at most so many seconds, that are left at the deadline of the work: no step is interrupted
RESERVE = 0.15
MOST_RESERVE = 0.25  # s
DEFAULT_TIME_LIMIT = 60.0  # s that planning has if no time limit is given
DEFAULT_CPU_LIMIT = 10.0  # s of processor time that planning has if no time limit is given

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)
_CPU_DEADLINE: ContextVar["_CpuDeadline | None"] = ContextVar("cpu_deadline", default=None)


@dataclass
class _CpuDeadline:
    """The end of the processor time of a block, ``time.process_time()``."""

    at: float


@contextmanager
def until(deadline: float) -> Iterator[None]:
    """Run a block with a deadline, ``time.monotonic()``; that of a block around it holds as well."""
    token = _DEADLINE.set(min(deadline, _DEADLINE.get()))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


@contextmanager
def within_cpu_time(seconds: float) -> Iterator[None]:
    """Run a block that may take some processor time of this process, however long it has to wait for the processor."""
    outer = _CPU_DEADLINE.get()
    token = _CPU_DEADLINE.set(_CpuDeadline(min(time.process_time() + seconds, math.inf if outer is None else outer.at)))
    try:
        yield
    finally:
        _CPU_DEADLINE.reset(token)


def give_cpu_time(seconds: float) -> None:
    """Let the block take so much more processor time, such as what compiling took."""
    end = _CPU_DEADLINE.get()
    if end is not None:
        end.at += seconds


def cpu_time_used_up() -> bool:
    """Whether the processor time of :func:`within_cpu_time` is used up."""
    end = _CPU_DEADLINE.get()
    if end is None or end.at == math.inf:  # to read the processor time takes longer than to read the clock
        return False
    return time.process_time() > end.at


def deadline() -> float:
    """The deadline, ``time.monotonic()``; infinite outside of such a block."""
    return _DEADLINE.get()


def usable(time_limit: float) -> float:
    """Seconds of a time limit (s) that work can use, so that its last step ends within the limit."""
    return time_limit - min(RESERVE * time_limit, MOST_RESERVE)


def check_time(ahead: float = 0.0) -> None:
    """Look at the clock.

    Args:
        ahead: s that the next step takes.

    Raises:
        PlannerError: TIME_LIMIT; the deadline has passed, or will pass within this step, or the processor time is used
            up.
    """
    if time.monotonic() + ahead > _DEADLINE.get() or cpu_time_used_up():
        raise PlannerError("no time is left", Code.TIME_LIMIT)
