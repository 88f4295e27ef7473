"""A limit of a search that counts checked motions, so that the result does not depend on the machine's speed."""

import time

import numpy as np

from hmap_core import clock


class SearchBudget:
    """A number of motions that a search can still check, and a time limit.

    Args:
        time_limit: wall-clock seconds from now.
        checks: number of motions; infinite: only the time limits the search.
        parent: a budget that this one is a part of; spending from this budget also spends from the parent.
        seconds: of the time limit that the search can use, if not all.

    Attributes:
        checks: number of motions that are left.
        time_limit: as given.
    """

    def __init__(
        self,
        time_limit: float,
        checks: float = np.inf,
        parent: "SearchBudget | None" = None,
        seconds: float | None = None,
    ):
        self.checks = checks
        self.time_limit = time_limit
        self._all_checks = checks
        self._deadline = time.monotonic() + (time_limit if seconds is None else seconds)
        self._parent = parent

    @property
    def exhausted(self) -> bool:
        """Whether no motion or no time is left."""
        return self.checks < 1 or time.monotonic() >= self._deadline

    @property
    def seconds(self) -> float:
        """Remaining wall-clock seconds."""
        return self._deadline - time.monotonic()

    @property
    def deadline(self) -> float:
        """The end of the time, ``time.monotonic()``."""
        return self._deadline

    @property
    def clock_deadline(self) -> float:
        """The end of the time, in seconds of ``clock.now``; for compiled code."""
        return clock.now() + self.seconds

    @property
    def ended_by(self) -> str:
        """What a search has used up that ended with this budget, for messages."""
        if self.checks < 1:
            return f"all its {self._all_checks:.0f} motions"
        return f"its time limit of {self.time_limit:g} s"

    def spend(self, checks: int) -> None:
        """Subtract checked motions from this budget and its parents."""
        self.checks -= checks
        if self._parent is not None:
            self._parent.spend(checks)

    def fraction(self, share: float) -> "SearchBudget":
        """A part of the remaining motions and time; ``share`` is in (0, 1]."""
        return SearchBudget(share * self.seconds, share * self.checks, self)
