"""Penetration at the samples and between them, by bounds on motion.

What the bounds of :mod:`hmap_core.validation.bounds` do not clear is measured: stretches are halved, down to the
samples and then between them, until the bound on the motion between two looks is under ``limits.MOTION_BOUND``.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.bounds import Bounds, PartBoxes
from hmap_core.validation.pairs import Pair
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Track, World


class Request(NamedTuple):
    """A step of a pair that has to be looked at between its samples.

    Attributes:
        pieces: into how many, a power of two.
        begin, end: the distances in metres at its two samples.
    """

    pair: Pair
    step: int
    pieces: int
    begin: float
    end: float


@dataclass
class Scan:
    """The state of the search through all pairs.

    Attributes:
        clearance: smallest distance found so far among the pairs that count.
        requests: what has to be looked at between two samples.
    """

    world: World
    findings: Findings
    clearance: float = np.inf
    requests: list[Request] = field(default_factory=list)

    def run(self, pairs: list[Pair]) -> None:
        """Look at all pairs."""
        boxes = PartBoxes(self.world)
        self._scan_still([pair for pair in pairs if not pair.moves], boxes)
        moving = [pair for pair in pairs if pair.moves]
        at_once = max(1, limits.SAMPLES_AT_ONCE // self.world.samples)
        for i in range(0, len(moving), at_once):
            self._scan_moving(moving[i : i + at_once], boxes)
        self._look_between()

    def _scan_still(self, pairs: list[Pair], boxes: PartBoxes) -> None:
        """Pairs that stay as they are: one look is enough."""
        gaps = boxes.gaps(*boxes.rows(pairs), np.zeros(len(pairs), int))
        for i in np.flatnonzero(gaps <= -limits.PENETRATION):
            _Walk(self, pairs[i]).distance(0)

    def _scan_moving(self, pairs: list[Pair], boxes: PartBoxes) -> None:
        """Pairs at the samples, nearest first, so that the smallest clearance is known early."""
        bounds = Bounds(self.world, boxes, pairs)
        walks = [_Walk(self, pair, travelled) for pair, travelled in zip(pairs, bounds.travelled, strict=True)]
        nearest = bounds.at_anchors.min(axis=1)
        order = np.argsort(nearest, kind="stable").tolist()
        for i in order:
            if pairs[i].clearance and nearest[i] < self.clearance:
                walks[i].distance(int(bounds.anchors[bounds.at_anchors[i].argmin()]))
        suspicious = bounds.suspicious(np.array([self.threshold(pair) for pair in pairs]))
        for i in order:
            for first, last in suspicious.get(i, ()):
                walks[i].descend(first, last)

    def threshold(self, pair: Pair) -> float:
        """The distance in metres from which on a pair is of no interest."""
        return max(-limits.PENETRATION, self.clearance if pair.clearance else -np.inf)

    def note(self, pair: Pair, time: float, distance: float) -> None:
        """Take a measured distance into account."""
        self.findings.check(Kind.PENETRATION, pair.names, time, -distance, limits.PENETRATION)
        if pair.clearance and distance < self.clearance:
            self.clearance = distance

    def _look_between(self) -> None:
        waiting = [r for r in self.requests if not self.findings.has(Kind.PENETRATION, r.pair.names)]
        for group in _grouped(sorted(waiting, key=lambda request: request.step)):
            pieces: dict[int, int] = {}
            for request in group:
                pieces[request.step] = max(pieces.get(request.step, 1), request.pieces)
            grid = _Grid(self.world, pieces)
            for request in group:
                self._bisect(request, grid)

    def _bisect(self, request: Request, grid: "_Grid") -> None:
        """Halve a step down to its pieces where the bound does not rule a penetration out."""
        pair, step, count, begin, end = request
        stack = [(0, count, begin, end)]
        while stack:
            i, j, d_i, d_j = stack.pop()
            motion = pair.motion[step] * (j - i) / count
            if j - i < 2 or (d_i + d_j - motion) / 2.0 >= -limits.PENETRATION:
                continue
            middle = (i + j) // 2
            d_middle = self._measure(pair, step, middle, count, grid)
            stack += [(i, middle, d_i, d_middle), (middle, j, d_middle, d_j)]

    def _measure(self, pair: Pair, step: int, j: int, count: int, grid: "_Grid") -> float:
        k = grid.index(step, j, count)
        distance = pair.gauge.distance(grid.track(pair.a).at(k), grid.track(pair.b).at(k))
        dt = self.world.document.dt
        self.note(pair, (step + j / count) * dt, distance)
        return distance


class _Walk:
    """One pair at the samples: distances, measured where needed.

    ``travelled`` (N,) bounds in metres how far the two have moved against each other; None for a pair that stays.
    """

    def __init__(self, scan: Scan, pair: Pair, travelled: np.ndarray | None = None):
        self._scan = scan
        self._pair = pair
        self._travelled = travelled
        self._measured: dict[int, float] = {}
        self._a, self._b = scan.world.tracks[pair.a], scan.world.tracks[pair.b]

    def distance(self, k: int) -> float:
        """The measured distance at a sample."""
        if k not in self._measured:
            distance = self._measured[k] = self._pair.gauge.distance(self._a.at(k), self._b.at(k))
            self._scan.note(self._pair, self._scan.world.document.time[k], distance)
        return self._measured[k]

    def descend(self, first: int, last: int) -> None:
        """Halve a run of steps until the bounds clear it or single steps remain, and ask for a look inside those."""
        travelled = self._travelled[first : last + 1].tolist()
        stack = [(first, last, self.distance(first), self.distance(last))]
        while stack:
            i, j, d_i, d_j = stack.pop()
            motion = travelled[j - first] - travelled[i - first]
            nearest = (d_i + d_j - motion) / 2.0
            if nearest >= self._scan.threshold(self._pair):
                continue
            if j - i > 1:
                middle = (i + j) // 2
                d_middle = self.distance(middle)
                stack += [(middle, j, d_middle, d_j), (i, middle, d_i, d_middle)]
            elif nearest < -limits.PENETRATION and motion > limits.MOTION_BOUND:
                self._scan.requests.append(Request(self._pair, i, _pieces(motion), d_i, d_j))


def _pieces(motion: float) -> int:
    """A power of two that cuts a motion (metres) into pieces under the bound."""
    pieces = 2 ** int(np.ceil(np.log2(min(motion / limits.MOTION_BOUND, float(limits.MAX_SUBDIVISION)))))
    return max(2, pieces)


def _grouped(requests: list[Request]) -> list[list[Request]]:
    """Cut requests, sorted by step, into groups whose instants fit in memory together."""
    groups: list[list[Request]] = []
    size, last = limits.INSTANTS_AT_ONCE, -1
    for request in requests:
        if request.step != last and size >= limits.INSTANTS_AT_ONCE:
            groups.append([])
            size = 0
        size += request.pieces if request.step != last else 0
        last = request.step
        groups[-1].append(request)
    return groups


class _Grid:
    """The world inside some steps, where its pieces meet; ``pieces`` is step -> number of pieces, a power of two."""

    def __init__(self, world: World, pieces: dict[int, int]):
        steps = sorted(pieces)
        counts = np.array([pieces[step] for step in steps])
        self._count = dict(zip(steps, counts.tolist(), strict=True))
        self._offset = dict(zip(steps, np.cumsum(np.append(0, counts[:-1] - 1)).tolist(), strict=True))
        fractions = np.concatenate([np.arange(1, count) / count for count in counts])
        self._state = world.between(np.repeat(steps, counts - 1), fractions)
        self._tracks: dict = {}

    def index(self, step: int, j: int, count: int) -> int:
        """Where the end of piece j, of ``count`` in a step, is stored."""
        return self._offset[step] + j * (self._count[step] // count) - 1

    def track(self, part) -> Track:
        if part not in self._tracks:
            self._tracks[part] = Track(part, self._state)
        return self._tracks[part]


def check(world: World, pairs: list[Pair], findings: Findings) -> float | None:
    """Report every penetration; the smallest clearance in metres, None when no pair counts."""
    scan = Scan(world, findings)
    scan.run(pairs)
    return float(scan.clearance) if np.isfinite(scan.clearance) else None
