"""Moves a parallel gripper, as the gripper action controllers do behind GripperCommand."""

from dataclasses import dataclass

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.execution.outcome import Outcome
from hmap_core.types import Gripper

GRIPPER_TOLERANCE = 0.001  # m, of the opening reached
GRIPPER_OVERSHOOT = 0.002  # m that a commanded opening may exceed the gripper's
STALL_VELOCITY = 0.002  # m/s, of the opening; slower counts as standing
STALL_TIME = 0.1  # s of standing short of the goal after which the gripper has stalled
STALL_DISTANCE = STALL_VELOCITY * STALL_TIME  # m; fingers that tremble within it stand as well


@dataclass(frozen=True)
class GripperResult:
    """What became of a gripper command, as in GripperCommand's result.

    Attributes:
        opening: gap between the pads, m.
        effort: N, mean of the fingers.
        reached: the commanded opening is reached.
        stalled: the fingers stand short of it, as when they hold something.
    """

    opening: float
    effort: float
    reached: bool
    stalled: bool


class GripperController:
    """Moves a gripper to an opening with a bounded force and says when it is there or stands; then keeps pressing.

    Attributes:
        outcome: of the last command, or None before the first.
        result: of the last update.
    """

    def __init__(self, gripper: Gripper, opening: float):
        self.outcome: Outcome | None = None
        self._gripper = gripper
        self._opening, self._force = float(opening), gripper.force
        self._still: tuple[float, float] | None = None  # since when (s), at which opening (m)
        self.result = GripperResult(self._opening, 0.0, reached=True, stalled=False)

    @property
    def active(self) -> bool:
        """Whether a command is under way."""
        return self.outcome is Outcome.ACTIVE

    def start(self, opening: float, max_effort: float = 0.0) -> None:
        """Go for a gap of ``opening`` metres with at most ``max_effort`` newtons (0: the gripper's own force).

        Raises:
            InputError: a value is not finite or out of range; what was active goes on.
        """
        upper = max(self._gripper.open_opening, self._gripper.max_opening)
        low, high = self._gripper.min_opening - GRIPPER_OVERSHOOT, upper + GRIPPER_OVERSHOOT
        if not (np.isfinite(opening) and low <= opening <= high):
            raise InputError(f"gripper opening {opening} m; it has to be in [{self._gripper.min_opening}, {upper}]")
        if not (np.isfinite(max_effort) and max_effort >= 0.0):
            raise InputError(f"gripper effort {max_effort} N; it has to be 0 (the gripper's own) or more")
        self._opening, self._force = float(opening), max_effort or self._gripper.force
        self._still = None
        self.outcome = Outcome.ACTIVE

    def cancel(self) -> None:
        """Stop where the fingers are, pressing as before."""
        if self.active:
            self._opening = self.result.opening
            self.outcome = Outcome.CANCELED

    def update(self, now: float, opening: float, velocity: float, effort: float = 0.0) -> tuple[float, float]:
        """Opening (m) and force (N) to command, given the measured opening, its velocity (m/s) and effort (N)."""
        reached = abs(opening - self._opening) <= GRIPPER_TOLERANCE
        if self._still is not None and abs(opening - self._still[1]) > STALL_DISTANCE:
            self._still = None
        if self._still is None and abs(velocity) <= STALL_VELOCITY:
            self._still = (now, opening)
        stalled = not reached and self._still is not None and now - self._still[0] >= STALL_TIME
        self.result = GripperResult(opening, effort, reached, stalled)
        if self.active and (reached or stalled):
            self.outcome = Outcome.SUCCEEDED if reached else Outcome.STALLED
        return self._opening, self._force
