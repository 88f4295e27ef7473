"""How much a search may do: counted, so that it ends in the same place however fast the machine is."""

import time

import numpy as np


class Effort:
    """Motions that the trees of a search may still check, and the time that bounds it in any case.

    Args:
        time_limit: wall-clock seconds from now.
        checks: motions; infinite: as many as there is time for.
        whole: an effort of which this one is a part; what is spent here is spent there too.

    Attributes:
        checks: motions that are left.
    """

    def __init__(self, time_limit: float, checks: float = np.inf, whole: "Effort | None" = None):
        self.checks = checks
        self._deadline = time.monotonic() + time_limit
        self._whole = whole

    @property
    def over(self) -> bool:
        """Whether there is nothing left."""
        return self.checks < 1 or time.monotonic() >= self._deadline

    def spend(self, checks: int) -> None:
        """Take off motions that were checked."""
        self.checks -= checks
        if self._whole is not None:
            self._whole.spend(checks)

    def share(self, part: float) -> "Effort":
        """A part, in (0, 1], of what is left of both."""
        return Effort(part * (self._deadline - time.monotonic()), part * self.checks, self)
