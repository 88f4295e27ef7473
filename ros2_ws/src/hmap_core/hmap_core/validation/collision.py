"""Penetration at the samples and between them, by bounds on motion.

The distance of two bodies changes no faster than their points move. So between two looks with distances d0 and d1, and
a bound m on the relative motion, the distance is nowhere below (d0 + d1 - m) / 2. Stretches for which this rules out a
penetration need no further look; the others are halved, down to the samples and then between them, until m is under
``limits.MOTION_BOUND``.
"""

from dataclasses import dataclass, field

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.pairs import Pair
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Track, World


@dataclass
class Scan:
    """The state of the search through all pairs.

    Attributes:
        clearance: smallest distance found so far among the pairs that count.
        requests: (pair, step, pieces) that have to be looked at between two samples.
    """

    world: World
    findings: Findings
    clearance: float = np.inf
    requests: list[tuple[Pair, int, int]] = field(default_factory=list)

    def run(self, pairs: list[Pair]) -> None:
        """Look at all pairs, nearest first, so that the smallest clearance is known early."""
        bounds = [pair.lower_bounds(self.world) for pair in pairs]
        for i in np.argsort([bound.min() for bound in bounds], kind="stable"):
            self._scan_pair(pairs[i], bounds[i])
        self._look_between()

    def _scan_pair(self, pair: Pair, bound: np.ndarray) -> None:
        walk = _Walk(self, pair, bound)
        if pair.clearance and bound.min() < self.clearance:
            walk.distance(int(bound.argmin()))
        if len(bound) == 1:
            if bound[0] <= -limits.PENETRATION:
                walk.distance(0)
            return
        for first, last in walk.suspicious():
            walk.descend(first, last)

    def note(self, pair: Pair, time: float, distance: float) -> None:
        """Take a measured distance into account."""
        self.findings.check(Kind.PENETRATION, pair.names, time, -distance, limits.PENETRATION)
        if pair.clearance and distance < self.clearance:
            self.clearance = distance

    def _look_between(self) -> None:
        waiting = [r for r in self.requests if not self.findings.has(Kind.PENETRATION, r[0].names)]
        for group in _grouped(sorted(waiting, key=lambda request: request[1])):
            pieces: dict[int, int] = {}
            for _, step, count in group:
                pieces[step] = max(pieces.get(step, 1), count)
            grid = _Grid(self.world, pieces)
            for pair, step, count in group:
                self._bisect(pair, step, count, grid)

    def _bisect(self, pair: Pair, step: int, count: int, grid: "_Grid") -> None:
        """Halve a step down to ``count`` pieces where the bound does not rule a penetration out."""
        known = {j: self._measure(pair, step, j, count, grid) for j in (0, count)}
        stack = [(0, count)]
        while stack:
            i, j = stack.pop()
            motion = pair.motion[step] * (j - i) / count
            if j - i < 2 or (known[i] + known[j] - motion) / 2.0 >= -limits.PENETRATION:
                continue
            middle = (i + j) // 2
            known[middle] = self._measure(pair, step, middle, count, grid)
            stack += [(i, middle), (middle, j)]

    def _measure(self, pair: Pair, step: int, j: int, count: int, grid: "_Grid") -> float:
        k = grid.index(step, j, count)
        distance = pair.gauge.distance(grid.track(pair.a).at(k), grid.track(pair.b).at(k))
        dt = self.world.document.dt
        self.note(pair, (step + j / count) * dt, distance)
        return distance


class _Walk:
    """One pair at the samples: distances (N,), first lower bounds, measured where needed."""

    def __init__(self, scan: Scan, pair: Pair, bound: np.ndarray):
        self._scan = scan
        self._pair = pair
        self._bound = bound
        self._measured = np.zeros(len(bound), bool)
        self._travelled = np.concatenate([[0.0], np.cumsum(pair.motion)])
        self._a, self._b = scan.world.tracks[pair.a], scan.world.tracks[pair.b]

    def _threshold(self) -> float:
        return max(-limits.PENETRATION, self._scan.clearance if self._pair.clearance else -np.inf)

    def suspicious(self) -> list[tuple[int, int]]:
        """Runs of steps (first and last sample) that the lower bounds alone do not clear."""
        d = self._bound
        bad = ~((d[:-1] + d[1:] - self._pair.motion) / 2.0 >= self._threshold())
        edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]])))
        return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))

    def distance(self, k: int) -> float:
        """The measured distance at a sample."""
        if not self._measured[k]:
            self._measured[k] = True
            self._bound[k] = self._pair.gauge.distance(self._a.at(k), self._b.at(k))
            self._scan.note(self._pair, self._scan.world.document.time[k], self._bound[k])
        return self._bound[k]

    def descend(self, first: int, last: int) -> None:
        """Halve a run of steps until the bounds clear it or single steps remain, and ask for a look inside those."""
        stack = [(first, last)]
        while stack:
            i, j = stack.pop()
            motion = self._travelled[j] - self._travelled[i]
            nearest = (self.distance(i) + self.distance(j) - motion) / 2.0
            if nearest >= self._threshold():
                continue
            if j - i > 1:
                middle = (i + j) // 2
                stack += [(middle, j), (i, middle)]
            elif nearest < -limits.PENETRATION and motion > limits.MOTION_BOUND:
                self._scan.requests.append((self._pair, i, _pieces(motion)))


def _pieces(motion: float) -> int:
    """A power of two that cuts a motion (metres) into pieces under the bound."""
    pieces = 2 ** int(np.ceil(np.log2(min(motion / limits.MOTION_BOUND, float(limits.MAX_SUBDIVISION)))))
    return max(2, pieces)


def _grouped(requests: list[tuple[Pair, int, int]]) -> list[list[tuple[Pair, int, int]]]:
    """Cut requests, sorted by step, into groups whose instants fit in memory together."""
    groups: list[list] = []
    size, last = limits.INSTANTS_AT_ONCE, -1
    for request in requests:
        if request[1] != last and size >= limits.INSTANTS_AT_ONCE:
            groups.append([])
            size = 0
        size += request[2] if request[1] != last else 0
        last = request[1]
        groups[-1].append(request)
    return groups


class _Grid:
    """The world at fractions of some steps; ``pieces`` is step -> number of pieces, a power of two."""

    def __init__(self, world: World, pieces: dict[int, int]):
        steps = sorted(pieces)
        counts = np.array([pieces[step] for step in steps])
        self._count = dict(zip(steps, counts.tolist(), strict=True))
        self._offset = dict(zip(steps, np.concatenate([[0], np.cumsum(counts + 1)[:-1]]).tolist(), strict=True))
        fractions = np.concatenate([np.arange(count + 1) / count for count in counts])
        self._state = world.between(np.repeat(steps, counts + 1), fractions)
        self._tracks: dict = {}

    def index(self, step: int, j: int, count: int) -> int:
        """Where piece end j of ``count`` in a step is stored."""
        return self._offset[step] + j * (self._count[step] // count)

    def track(self, part) -> Track:
        if part not in self._tracks:
            self._tracks[part] = Track(part, self._state)
        return self._tracks[part]


def check(world: World, pairs: list[Pair], findings: Findings) -> float | None:
    """Report every penetration; the smallest clearance in metres, None when no pair counts."""
    scan = Scan(world, findings)
    scan.run(pairs)
    return float(scan.clearance) if np.isfinite(scan.clearance) else None
