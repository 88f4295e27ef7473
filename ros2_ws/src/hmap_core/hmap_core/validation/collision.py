"""Penetration at the samples and between them, by conservative bounds on motion.

Intervals that the bounds of :mod:`hmap_core.validation.bounds` do not clear are bisected with measured distances: first
down to the samples, then between them, until the bound on the motion between two measurements is below
``limits.MOTION_BOUND``. Where a held body overlaps another one a little, :mod:`hmap_core.validation.head_on` looks
closer.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hmap_core.validation import head_on, limits
from hmap_core.validation.bounds import Bounds, PartBoxes
from hmap_core.validation.head_on import Overlap
from hmap_core.validation.held import NOTHING_HELD, HeldBodies
from hmap_core.validation.pairs import Pair
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, Track, World


class Subdivision(NamedTuple):
    """A step of a pair that has to be measured between its samples.

    Attributes:
        pair: the pair.
        step: number of the step.
        intervals: number of intervals that the step is divided into, a power of two.
        begin, end: distances at the two samples of the step, m.
    """

    pair: Pair
    step: int
    intervals: int
    begin: float
    end: float


class Clearance(NamedTuple):
    """Smallest distances found among some pairs, m; None where no pair counts.

    Attributes:
        every: of the pairs that count for the plan's clearance.
        held: of those of them that are a body that a contact moves and another body.
    """

    every: float | None
    held: float | None


@dataclass
class Scan:
    """Measures all pairs of a world.

    Attributes:
        world: the plan.
        findings: receives the penetrations.
        held: the bodies that contacts move.
        clearance: smallest distance found so far among the pairs that count for the clearance, m.
        held_clearance: the same among those of held bodies and other bodies, m.
        overlaps: where held bodies overlap others by more than flush surfaces may, by pair.
        subdivisions: the steps that remain to be measured between their samples.
    """

    world: World
    findings: Findings
    held: HeldBodies = NOTHING_HELD
    clearance: float = np.inf
    held_clearance: float = np.inf
    overlaps: dict[Pair, list[Overlap]] = field(default_factory=dict)
    subdivisions: list[Subdivision] = field(default_factory=list)

    def run(self, pairs: list[Pair]) -> None:
        """Checks all pairs, at the samples and between them."""
        if not pairs:
            return
        boxes = PartBoxes(self.world)
        self._scan_static([pair for pair in pairs if not pair.moves], boxes)
        moving = [pair for pair in pairs if pair.moves]
        at_once = max(1, limits.MAX_PAIR_SAMPLES // self.world.samples)
        for i in range(0, len(moving), at_once):
            self._scan_moving(moving[i : i + at_once], boxes)
        self._check_between()
        for pair, overlaps in self.overlaps.items():
            if not self.findings.has(Kind.PENETRATION, pair.names):
                head_on.check(self.world, self.held, pair, overlaps, self.findings)

    def _scan_static(self, pairs: list[Pair], boxes: PartBoxes) -> None:
        """Measures pairs without relative motion, at the first sample only."""
        gaps = boxes.gaps(*boxes.rows(pairs), np.zeros(len(pairs), int))
        for i in np.flatnonzero(gaps <= -limits.PENETRATION):
            _PairDistances(self, pairs[i]).distance(0)

    def _scan_moving(self, pairs: list[Pair], boxes: PartBoxes) -> None:
        """Measures moving pairs at the samples, nearest first, so that the smallest clearance is known early."""
        bounds = Bounds(self.world, boxes, pairs)
        self.world.check_time()
        measured = [_PairDistances(self, pair, bound) for pair, bound in zip(pairs, bounds.travelled, strict=True)]
        nearest = bounds.at_anchors.min(axis=1)
        order = np.argsort(nearest, kind="stable").tolist()
        for i in order:
            if pairs[i].clearance and nearest[i] < self._smallest(pairs[i]):
                measured[i].distance(int(bounds.anchors[bounds.at_anchors[i].argmin()]))
        uncleared = bounds.uncleared(np.array([self.threshold(pair) for pair in pairs]))
        for i in order:
            for first, last in uncleared.get(i, ()):
                measured[i].bisect(first, last)

    def threshold(self, pair: Pair) -> float:
        """The distance in metres above which a pair needs no further measurement."""
        return max(-pair.depth, self._smallest(pair) if pair.clearance else -np.inf)

    def _smallest(self, pair: Pair) -> float:
        """The clearance that a pair which counts for it may make smaller, m."""
        return self.held_clearance if pair.held_clearance else self.clearance  # which is smaller

    def note(self, pair: Pair, at: float, time: float, distance: float) -> None:
        """Records a distance (m) that a pair's gauge has just measured, at an instant in steps and its time (s)."""
        self.findings.check(Kind.PENETRATION, pair.names, time, -distance, limits.PENETRATION)
        if pair.clearance:
            self.clearance = min(self.clearance, distance)
        if pair.held_clearance:
            self.held_clearance = min(self.held_clearance, distance)
        if pair.held and distance < -limits.HEAD_ON:
            overlap = Overlap(at, -distance, np.array(pair.gauge.result.normal))
            self.overlaps.setdefault(pair, []).append(overlap)

    def _check_between(self) -> None:
        waiting = [r for r in self.subdivisions if not self.findings.has(Kind.PENETRATION, r.pair.names)]
        for group in _grouped(sorted(waiting, key=lambda subdivision: subdivision.step)):
            intervals: dict[int, int] = {}
            for subdivision in group:
                intervals[subdivision.step] = max(intervals.get(subdivision.step, 1), subdivision.intervals)
            subsamples = _Subsamples(self.world, intervals)
            for subdivision in group:
                self._bisect(subdivision, subsamples)

    def _bisect(self, subdivision: Subdivision, subsamples: "_Subsamples") -> None:
        """Bisects a step down to its intervals wherever the bound does not exclude a penetration."""
        pair, step, count, begin, end = subdivision
        stack = [(0, count, begin, end)]
        while stack:
            i, j, d_i, d_j = stack.pop()
            motion = pair.motion[step] * (j - i) / count
            if j - i < 2 or (d_i + d_j - motion) / 2.0 >= -pair.depth:
                continue
            middle = (i + j) // 2
            d_middle = self._measure(pair, step, middle, count, subsamples)
            stack += [(i, middle, d_i, d_middle), (middle, j, d_middle, d_j)]

    def _measure(self, pair: Pair, step: int, j: int, count: int, subsamples: "_Subsamples") -> float:
        k = subsamples.index(step, j, count)
        distance = pair.gauge.distance(subsamples.track(pair.a).at(k), subsamples.track(pair.b).at(k))
        at = step + j / count
        self.note(pair, at, at * self.world.document.dt, distance)
        return distance


class _PairDistances:
    """Distances of one pair at the samples, measured on demand.

    Args:
        scan: receives the measurements.
        pair: the pair.
        travelled: (N,) bound on the relative motion since the start, m; None for a pair without relative motion.
    """

    def __init__(self, scan: Scan, pair: Pair, travelled: np.ndarray | None = None):
        self._scan = scan
        self._pair = pair
        self._travelled = travelled
        self._measured: dict[int, float] = {}
        self._normals: dict[int, np.ndarray] = {}
        self._a, self._b = scan.world.tracks[pair.a], scan.world.tracks[pair.b]

    def distance(self, k: int) -> float:
        """The measured distance in metres at sample k."""
        if k not in self._measured:
            self._scan.world.check_time()
            gauge = self._pair.gauge
            distance = self._measured[k] = gauge.distance(self._a.at(k), self._b.at(k))
            self._normals[k] = np.array(gauge.result.normal)
            self._scan.note(self._pair, k, self._scan.world.document.time[k], distance)
        return self._measured[k]

    def bisect(self, first: int, last: int) -> None:
        """Bisects a run of steps until the bounds clear it; single steps that are not clear are subdivided later."""
        if self._travelled is None:
            raise ValueError(f"the pair {self._pair.names} has no relative motion to bisect")
        travelled = self._travelled[first : last + 1].tolist()
        stack = [(first, last)]
        while stack:
            i, j = stack.pop()
            d_i, d_j = self.distance(i), self.distance(j)
            motion = travelled[j - first] - travelled[i - first]
            nearest = (d_i + d_j - motion) / 2.0
            if nearest >= self._scan.threshold(self._pair):
                continue
            if j - i > 1:
                stack += self._unseparated(i, j)
            elif nearest < -self._pair.depth and motion > limits.MOTION_BOUND and not self._separated(i):
                self._scan.subdivisions.append(Subdivision(self._pair, i, _intervals(motion), d_i, d_j))

    def _unseparated(self, i: int, j: int) -> list[tuple[int, int]]:
        """Runs of steps between two samples, in either half, that the separating axis at the middle does not clear."""
        middle = (i + j) // 2
        self.distance(middle)
        bounds = self._pair.axes.bounds(self._normals[middle], middle, i, j)
        left = ~(bounds >= self._scan.threshold(self._pair))
        if left.all():
            return [(middle, j), (i, middle)]
        runs: list[tuple[int, int]] = []
        for step in (np.flatnonzero(left)[::-1] + i).tolist():
            if runs and runs[-1][0] == step + 1 and step + 1 != middle:
                runs[-1] = (step, runs[-1][1])
            else:
                runs.append((step, step + 1))
        return runs

    def _separated(self, i: int) -> bool:
        """Whether the separating axis at either end of a step excludes an overlap in it that matters."""
        return any(self._pair.axes.bounds(self._normals[k], k, i, i + 1)[0] >= -self._pair.depth for k in (i, i + 1))


def _intervals(motion: float) -> int:
    """The number of intervals, a power of two, that divides a motion (m) into parts below ``limits.MOTION_BOUND``."""
    intervals = 2 ** int(np.ceil(np.log2(min(motion / limits.MOTION_BOUND, float(limits.MAX_SUBDIVISION)))))
    return max(2, intervals)


def _grouped(subdivisions: list[Subdivision]) -> list[list[Subdivision]]:
    """Splits subdivisions, sorted by step, into groups whose instants fit in memory."""
    groups: list[list[Subdivision]] = []
    size, last = limits.MAX_INSTANTS, -1
    for subdivision in subdivisions:
        if subdivision.step != last and size >= limits.MAX_INSTANTS:
            groups.append([])
            size = 0
        size += subdivision.intervals if subdivision.step != last else 0
        last = subdivision.step
        groups[-1].append(subdivision)
    return groups


class _Subsamples:
    """The world at the interval borders inside some steps.

    Args:
        world: the plan.
        intervals: step -> number of intervals, a power of two.
    """

    def __init__(self, world: World, intervals: dict[int, int]):
        steps = sorted(intervals)
        counts = np.array([intervals[step] for step in steps])
        self._count = dict(zip(steps, counts.tolist(), strict=True))
        self._offset = dict(zip(steps, np.cumsum(np.append(0, counts[:-1] - 1)).tolist(), strict=True))
        fractions = np.concatenate([np.arange(1, count) / count for count in counts])
        self._state = world.between(np.repeat(steps, counts - 1), fractions)
        self._tracks: dict = {}

    def index(self, step: int, j: int, count: int) -> int:
        """Storage index of the end of interval j, of ``count`` intervals of a step."""
        return self._offset[step] + j * (self._count[step] // count) - 1

    def track(self, part: Part) -> Track:
        if part not in self._tracks:
            self._tracks[part] = Track(part, self._state)
        return self._tracks[part]


def check(world: World, pairs: list[Pair], findings: Findings, held: HeldBodies = NOTHING_HELD) -> Clearance:
    """Reports every penetration, and held bodies that run head-on into others.

    Args:
        world: the plan.
        pairs: the pairs to check.
        findings: receives the violations.
        held: the bodies that contacts move.

    Returns:
        The smallest clearances.
    """
    scan = Scan(world, findings, held)
    scan.run(pairs)
    return Clearance(*(float(d) if np.isfinite(d) else None for d in (scan.clearance, scan.held_clearance)))
