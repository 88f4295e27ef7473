"""Held bodies that run into a face of another body, although the two overlap little.

The depth of two convex bodies is their overlap along the direction in which it is smallest. A book that is carried half
a millimetre too low meets the front of a board, and goes on: along its way it is soon deep inside the board, but the
depth stays half a millimetre, which is how far the book is below the top. In reality the board stops the book.

So the judge asks along which normal the two met. An overlap along a normal n is no harm if they met along n: a book
that is put on a board. It is head-on if they overlapped along n already when they met along another normal, n0, and if
the body has gone on along n0 since.
"""

from typing import NamedTuple

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.axes import gap_along
from hmap_core.validation.geometry import Gauge
from hmap_core.validation.held import HeldBodies
from hmap_core.validation.near import nearest_first
from hmap_core.validation.pairs import Pair
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, Track, World

HALVINGS = 24  # of a step, at most, to find the instant at which two parts meet


class Overlap(NamedTuple):
    """Two parts a and b that overlap at an instant.

    Attributes:
        at: the instant, in steps: sample k is at k.
        depth: m.
        normal: (3,) unit vector from a to b along which the depth is measured, world frame.
    """

    at: float
    depth: float
    normal: np.ndarray


class _Axis(NamedTuple):
    """A direction from a part to another, fixed to both of them: unit vectors (3,) in the frames of both."""

    own: np.ndarray
    others: np.ndarray

    def gaps(self, part: Track, other: Track, rows: slice) -> np.ndarray:
        """Gaps (n,) along the axis at some instants, m.

        The larger one of the two frames counts: a body that turns about an edge keeps the normal of its own face, or
        that of the other body's.
        """
        return np.maximum(gap_along(part, other, self.own, rows), gap_along(other, part, -self.others, rows))


class _Instant(NamedTuple):
    """Where the two parts are at an instant: row k of their tracks."""

    part: Track
    other: Track
    k: int

    def axis(self, normal: np.ndarray) -> _Axis:
        """The axis that is along a normal (3,), world frame, now."""
        return _Axis(self.part.R[self.k].T @ normal, self.other.R[self.k].T @ normal)

    def gap(self, axis: _Axis) -> float:
        """The gap along an axis now, m."""
        return float(axis.gaps(self.part, self.other, slice(self.k, self.k + 1))[0])

    def witness(self, gauge: Gauge) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Distance, points and normal of the two now; see :meth:`Gauge.witness`."""
        return gauge.witness(self.part.at(self.k), self.other.at(self.k))


class _Meeting:
    """How a part of a body that a contact moves came to overlap another part.

    Args:
        world: the plan.
        held: the bodies that contacts move.
        part, other: the parts.
    """

    def __init__(self, world: World, held: HeldBodies, part: Part, other: Part):
        self._world, self._held = world, held
        self._part, self._other = part, other
        self._tracks = world.tracks[part], world.tracks[other]
        self._gauge = world.gauge(part, other)
        self._distances: dict[int, float] = {}
        self._entries: dict[tuple[float, float], tuple[float, _Instant]] = {}

    def head_on(self, at: float, normal: np.ndarray) -> bool:
        """Whether the part ran head-on into the other one before they overlap along a normal (3,), world frame.

        Args:
            at: the instant of the overlap, in steps.
            normal: from the part to the other one.
        """
        now = self._at(at)
        axis = now.axis(normal)
        step = self._step_of_entry(at, axis)
        if step is None or not self._held.in_step(self._part, step):
            return False
        met, then = self._entry(step, min(step + 1.0, at))
        overlap = -then.gap(axis)
        if overlap <= limits.HEAD_ON or not self._went_on(then, now):
            return False
        return overlap - self._sunk(normal, round(met)) > limits.HEAD_ON

    def _step_of_entry(self, at: float, axis: _Axis) -> int | None:
        """The last step before an instant in which the parts came to overlap; None if they met along the axis."""
        last = int(np.ceil(at)) - 1
        if last < 0:
            return None
        clear = np.flatnonzero(axis.gaps(*self._tracks, slice(last + 1)) >= -limits.HEAD_ON)
        for k in range(last, int(clear[-1]) - 1 if len(clear) else -1, -1):
            if self._distance(k) > -limits.TOUCH_DEPTH:
                return k
        return None

    def _entry(self, first: float, last: float) -> tuple[float, _Instant]:
        """The instant between two others, in steps, at which the parts met: they overlap by about ``TOUCH_DEPTH``."""
        if (first, last) not in self._entries:
            begin, met = first, last
            for _ in range(HALVINGS):
                middle = (begin + met) / 2.0
                depth = -self._at(middle).witness(self._gauge)[0]
                begin, met = (middle, met) if depth < limits.TOUCH_DEPTH else (begin, middle)
                if limits.TOUCH_DEPTH <= depth < 1.5 * limits.TOUCH_DEPTH:
                    break
            self._entries[first, last] = met, self._at(met)
        return self._entries[first, last]

    def _went_on(self, then: _Instant, now: _Instant) -> bool:
        """Whether the part has moved into the other one since they met, along the normal along which they met."""
        _, on_part, on_other, normal = then.witness(self._gauge)
        if -now.gap(then.axis(normal)) <= limits.PENETRATION:
            return False
        point = (on_part + on_other) / 2.0
        own = _carried(point, then.part, then.k, now.part, now.k)
        others = _carried(point, then.other, then.k, now.other, now.k)
        moved = then.other.R[then.k] @ now.other.R[now.k].T @ (own - others)
        return bool(moved @ normal >= np.cos(limits.HEAD_ON_ANGLE) * np.linalg.norm(moved))

    def _sunk(self, normal: np.ndarray, k: int) -> float:
        """How deep the part's body lies in other parts along a normal at sample k, m.

        A body that lies in one of two tables, one beside the other, is not held back by the edge of the second.
        """
        world = self._world
        bodies = [i for i, part in enumerate(world.parts) if part.link is None and part is not self._other]
        own = np.array([world.parts[i].holder == self._part.holder for i in bodies], bool)
        numbers = np.array(bodies, int)
        sunk = 0.0
        for bound, (i, j) in nearest_first(world, numbers[own], numbers[~own], k):
            if bound > 0.0:
                break
            a, b = world.parts[i], world.parts[j]
            distance, _, _, along = world.gauge(a, b).witness(world.tracks[a].at(k), world.tracks[b].at(k))
            if along @ normal >= np.cos(limits.SAME_NORMAL):
                sunk = max(sunk, -distance)
        return sunk

    def _distance(self, k: int) -> float:
        if k not in self._distances:
            self._distances[k] = _Instant(*self._tracks, k).witness(self._gauge)[0]
        return self._distances[k]

    def _at(self, instant: float) -> _Instant:
        """The two parts at an instant, given in steps."""
        step = int(instant)
        if instant == step:
            return _Instant(*self._tracks, step)
        state = self._world.between(np.array([step]), np.array([instant - step]))
        return _Instant(Track(self._part, state), Track(self._other, state), 0)


def _carried(point: np.ndarray, then: Track, k: int, now: Track, j: int) -> np.ndarray:
    """Where a point (3,) that is fixed to a part at one instant is at another."""
    return now.R[j] @ then.R[k].T @ (point - then.p[k]) + now.p[j]


def check(world: World, held: HeldBodies, pair: Pair, overlaps: list[Overlap], findings: Findings) -> None:
    """Reports parts that ran into each other head-on.

    Args:
        world: the plan.
        held: the bodies that contacts move.
        pair: two parts that :meth:`HeldBodies.concerns`.
        overlaps: where they overlap by more than ``limits.HEAD_ON``.
        findings: receives the violations.
    """
    at_samples = {overlap.at for overlap in overlaps}
    telling = [o for o in overlaps if not {np.floor(o.at), np.ceil(o.at)} <= at_samples or o.at % 1.0 == 0.0]
    for part, other, sign in ((pair.a, pair.b, 1.0), (pair.b, pair.a, -1.0)):
        if not held.moves(part):
            continue
        meeting = _Meeting(world, held, part, other)
        for overlap in sorted(telling, key=lambda found: found.at):
            world.check_time()
            if meeting.head_on(overlap.at, sign * overlap.normal):
                time = overlap.at * world.document.dt
                findings.check(Kind.HEAD_ON, (part.owner, other.owner), time, overlap.depth, limits.HEAD_ON)
