"""Skeletons: who touches, holds and carries what in which phases, in RAI's vocabulary.

``Skeleton([SkeletonEntry(1, 1, "touch", ("panda", "box"), contact), SkeletonEntry(1, 2, "stable", ("panda", "box")),
SkeletonEntry(2, 2, "pose_eq", ("box",), goal)])`` is a pick and place: the first phase ends where the hand touches the
box, which from then on hangs on the hand, and the second phase ends with the box at its goal. The text of a skeleton is
checked here; :mod:`hmap_core.komo.skeleton_problem` makes a ``KomoProblem`` of it.

The vocabulary is that of Toussaint, Logic-Geometric Programming, 2015, and of RAI's ``KOMO/skeleton.h``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NoReturn

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.types import ContactPoint

MAX_PHASES = 62  # a bit each in the masks of the collision model
TO_THE_END = -1.0  # as phase1
UNIT_TOLERANCE = 1e-3  # by which the length of a given quaternion may miss 1


class Symbol(StrEnum):
    """What an entry asks for; in brackets its frames, then its target."""

    TOUCH = "touch"  # (manipulator, object): the two meet; a ContactPoint, or T_obj_manipulator (7,)
    STABLE = "stable"  # (manipulator, object): the object hangs rigidly on it; the contact, where no touch gives it
    POSE_EQ = "pose_eq"  # (frame[, reference]): its pose (7,) there, or one per step (S, 7)
    POSITION_EQ = "position_eq"  # (frame[, reference]): its position (3,) there, or one per step (S, 3)
    ABOVE = "above"  # (object, support): stands upright on the support's top, not beyond its edges
    HOME = "home"  # (robot, ...), all that move: their joints (n,), or one row per step (S, n); by default at home


FRAMES = {
    Symbol.TOUCH: (2, 2),
    Symbol.STABLE: (2, 2),
    Symbol.POSE_EQ: (1, 2),
    Symbol.POSITION_EQ: (1, 2),
    Symbol.ABOVE: (2, 2),
    Symbol.HOME: (1, 8),
}  # least and most frames of a symbol
COLUMNS = {Symbol.POSE_EQ: 7, Symbol.POSITION_EQ: 3}


@dataclass(frozen=True)
class SkeletonEntry:
    """A symbol over phases. Phase p is the end of the p-th phase; 0 is the start.

    Attributes:
        phase0, phase1: first and last phase; the same for an instant, phase1 -1 for the end of the skeleton.
        symbol: what holds then, a :class:`Symbol` or its text.
        frames: names of robots (their end-effectors) and bodies, as :class:`Symbol` says.
        target: what the symbol aims at, as :class:`Symbol` says; poses in metres and unit quaternions xyzw.
    """

    phase0: float
    phase1: float
    symbol: Symbol
    frames: tuple[str, ...]
    target: Any = None

    def __post_init__(self):
        try:
            object.__setattr__(self, "symbol", Symbol(self.symbol))
        except ValueError:
            known = ", ".join(Symbol)
            raise InputError(f"skeleton entry '{self.symbol}': no such symbol; there are {known}") from None
        frames = (self.frames,) if isinstance(self.frames, str) else tuple(self.frames)
        object.__setattr__(self, "frames", frames)
        least, most = FRAMES[self.symbol]
        if not least <= len(frames) <= most or len(set(frames)) < len(frames):
            self.reject(f"needs {least} to {most} different frames" if least < most else f"needs {least} frames")
        if not 0.0 <= self.phase0 <= MAX_PHASES or (self.phase1 != TO_THE_END and not self.phase1 >= self.phase0):
            self.reject(f"phases must rise, from 0 to at most {MAX_PHASES}")
        if self.symbol in COLUMNS:
            self._check_target(COLUMNS[self.symbol])
        elif self.symbol in (Symbol.TOUCH, Symbol.STABLE) and not isinstance(self.target, ContactPoint | None):
            self._check_target(COLUMNS[Symbol.POSE_EQ])
            if self.target.ndim > 1:
                self.reject("its target must be one contact")

    def _check_target(self, columns: int) -> None:
        rows = np.asarray(self.target if self.target is not None else np.nan, float)
        finite = all(map(math.isfinite, rows.ravel().tolist()))
        if rows.ndim not in (1, 2) or rows.shape[-1] != columns or not finite:
            self.reject(f"its target must be {columns} finite numbers, or a row of them per step")
        if columns == 7:
            lengths = (math.hypot(*quaternion) for quaternion in rows[..., 3:].reshape(-1, 4).tolist())
            if not all(abs(length - 1.0) <= UNIT_TOLERANCE for length in lengths):
                self.reject("the quaternion of its target must have length 1")
        object.__setattr__(self, "target", rows)

    def __str__(self) -> str:
        end = "the end" if self.phase1 == TO_THE_END else f"{self.phase1:g}"
        return f"'{self.symbol} {' '.join(self.frames)}' (phases {self.phase0:g} to {end})"

    def reject(self, why: str) -> NoReturn:
        """Raises the InputError that names this entry."""
        raise InputError(f"skeleton entry {self}: {why}")


@dataclass(frozen=True)
class ModeSwitch:
    """An object that changes what it is stable on; None: it stands by itself."""

    phase: int
    object: str
    before: str | None
    after: str | None


class Skeleton:
    """A sequence of modes s_1:K with what is asked in them.

    Args:
        entries: what is asked.
        phases: their number K; by default as many as the entries name.

    Attributes:
        entries: with phase1 resolved.
        phases: their number K.

    Raises:
        InputError: names the entry that does not fit the others.
    """

    def __init__(self, entries: Sequence[SkeletonEntry], phases: int = 0):
        if not entries:
            raise InputError("a skeleton needs entries")
        last = max(max(e.phase0, e.phase1) for e in entries)
        self.phases = max(math.ceil(last), phases)
        self.entries = tuple(
            SkeletonEntry(e.phase0, self.phases, e.symbol, e.frames, e.target) if e.phase1 == TO_THE_END else e
            for e in entries
        )
        for entry in self.entries:
            if entry.phase1 == 0.0:
                entry.reject("the start is given; phase 1 is the end of the first phase")
        self._held = self._holds()
        self._contacts = {id(e): self._contact(e) for e in self.of(Symbol.TOUCH, Symbol.STABLE)}

    def then(self, other: "Skeleton") -> "Skeleton":
        """This skeleton, and after its last phase another one."""
        later = [
            SkeletonEntry(e.phase0 + self.phases, e.phase1 + self.phases, e.symbol, e.frames, e.target)
            for e in other.entries
        ]
        return Skeleton([*self.entries, *later], self.phases + other.phases)

    def of(self, *symbols: Symbol) -> list[SkeletonEntry]:
        """The entries of some symbols, in their order."""
        return [e for e in self.entries if e.symbol in symbols]

    def stable_on(self, name: str, phase: int) -> SkeletonEntry | None:
        """The ``stable`` entry of an object in the phase number ``phase`` (0: the first); None where it stands."""
        return self._held.get(name, {}).get(phase)

    def contact(self, entry: SkeletonEntry) -> ContactPoint | np.ndarray | None:
        """What a touch or stable entry has the manipulator hold on to; for stable also from the touch before it."""
        return self._contacts[id(entry)]

    def _contact(self, entry: SkeletonEntry) -> ContactPoint | np.ndarray | None:
        if entry.target is not None:
            return entry.target
        for touch in self.of(Symbol.TOUCH):
            if touch.frames == entry.frames and touch.phase0 <= entry.phase0 <= touch.phase1:
                return touch.target
        return None

    def prescribes(self, name: str, phases: range) -> bool:
        """Whether a world pose of an object is given at every step of some phases."""
        return any(
            e.frames == (name,) and e.target.ndim == 2 and e.phase0 <= phases.start and phases.stop <= e.phase1
            for e in self.of(Symbol.POSE_EQ)
        )

    def switches(self) -> list[ModeSwitch]:
        """All mode switches, by phase."""
        found = []
        for name, held in self._held.items():
            holders = [held[k].frames[0] if k in held else None for k in range(self.phases)]
            if holders[0] is not None:
                found.append(ModeSwitch(0, name, None, holders[0]))
            found += [
                ModeSwitch(k, name, a, b)
                for k, (a, b) in enumerate(zip(holders, holders[1:], strict=False), 1)
                if a != b or (b is not None and held[k] is not held[k - 1])
            ]
        return sorted(found, key=lambda switch: (switch.phase, switch.object))

    def _holds(self) -> dict[str, dict[int, SkeletonEntry]]:
        """Object -> phase -> the entry that it is stable by."""
        holds: dict[str, dict[int, SkeletonEntry]] = {}
        for entry in self.of(Symbol.STABLE):
            if entry.phase0 % 1 or entry.phase1 % 1 or entry.phase0 == entry.phase1:
                entry.reject("modes last for whole phases")
            held = holds.setdefault(entry.frames[1], {})
            for k in range(int(entry.phase0), int(entry.phase1)):
                if k in held:
                    entry.reject(f"it is stable by {held[k]} at the same time")
                held[k] = entry
        return holds

    def __repr__(self) -> str:
        return "Skeleton:\n" + "\n".join(f"  {entry}" for entry in self.entries)
