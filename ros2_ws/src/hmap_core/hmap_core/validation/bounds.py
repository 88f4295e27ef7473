"""Lower bounds on distances from bounding boxes, for many pairs at once.

The distance of two bodies changes no faster than their points move. Let d0 and d1 be distances at two instants, or
lower bounds of them, and m a bound on the relative motion in between. Then the distance is nowhere below
(d0 + d1 - m) / 2.
"""

import numpy as np

from hmap_core.validation.geometry import Boxes, box_gap
from hmap_core.validation.pairs import Pair
from hmap_core.validation.world import Track, World

STRIDE = 16  # samples between two anchors, at which the boxes of all pairs are compared
AT_ONCE = 512  # pairs whose motion is summed up between two looks at the clock
BATCH = 4096  # boxes that are compared together, so that their data fit in a processor cache


class PartBoxes:
    """Oriented bounding boxes of all parts of a world at all samples; one box of those that do not move."""

    def __init__(self, world: World):
        self._row = {part: i for i, part in enumerate(world.parts)}
        self._check_time = world.check_time
        tracks = [world.tracks[part] for part in world.parts]
        counts = np.array([1 if track.still else world.samples for track in tracks], int)
        self._first = np.cumsum(counts) - counts
        self._step = np.minimum(counts - 1, 1)  # from the box of one sample to that of the next
        self._boxes = Boxes.join(
            [self._around(t, n) for t, n in zip(tracks, counts.tolist(), strict=True)], self._check_time
        )

    def _around(self, track: Track, count: int) -> Boxes:
        self._check_time()
        return Boxes.around(track.part.solid, track.R[:count], track.p[:count])

    def rows(self, pairs: list[Pair]) -> tuple[np.ndarray, np.ndarray]:
        """Row numbers (n,) and (n,) of the parts of n pairs, as :meth:`gaps` expects them."""
        a, b = [self._row[pair.a] for pair in pairs], [self._row[pair.b] for pair in pairs]
        return np.array(a, int), np.array(b, int)

    def gaps(self, a: np.ndarray, b: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Lower bounds on the distances of n pairs of parts, each at one sample.

        Args:
            a, b: (n,) row numbers of the parts, see :meth:`rows`.
            samples: (n,) sample numbers.

        Returns:
            (n,) in metres; -inf where the boxes overlap.
        """
        a, b = (self._first[part] + self._step[part] * samples for part in (a, b))
        blocks = [slice(i, i + BATCH) for i in range(0, len(a), BATCH)]
        gaps = []
        for block in blocks:
            self._check_time()
            gaps.append(box_gap(self._boxes[a[block]], self._boxes[b[block]]))
        return np.concatenate(gaps) if gaps else np.zeros(0)


class Bounds:
    """Lower bounds on the distances of n pairs over the whole plan.

    Attributes:
        anchors: (A,) samples at which the boxes of all pairs are compared; the first and last sample are among them.
        at_anchors: (n, A) lower bounds from these comparisons, m; -inf where the boxes overlap.
        travelled: (n, N) bound on the relative motion from the start to each sample, m.
    """

    def __init__(self, world: World, boxes: PartBoxes, pairs: list[Pair]):
        self._boxes = boxes
        self._a, self._b = boxes.rows(pairs)
        self.anchors = np.unique(np.append(np.arange(0, world.samples, STRIDE), world.samples - 1))
        grid = np.meshgrid(np.arange(len(pairs)), self.anchors, indexing="ij")
        self.at_anchors = self._gaps(*(index.ravel() for index in grid)).reshape(len(pairs), len(self.anchors))
        world.check_time()
        self.travelled = np.zeros((len(pairs), world.samples))
        for first in range(0, len(pairs), AT_ONCE):
            world.check_time()
            rows = slice(first, first + AT_ONCE)
            np.cumsum([pair.motion for pair in pairs[rows]], axis=1, out=self.travelled[rows, 1:])

    def _gaps(self, rows: np.ndarray, samples: np.ndarray) -> np.ndarray:
        return self._boxes.gaps(self._a[rows], self._b[rows], samples)

    def uncleared(self, threshold: np.ndarray) -> dict[int, list[tuple[int, int]]]:
        """Steps in which the bounds do not exclude a distance below the threshold.

        Intervals between anchors are bisected, down to single steps, as long as the bounds do not clear them.

        Args:
            threshold: (n,) distance of each pair, m.

        Returns:
            Runs of steps as (first sample, last sample), by index of the pair; pairs that are clear are omitted.
        """
        row, interval = (index.ravel() for index in np.indices((len(self._a), len(self.anchors) - 1)))
        first, last = self.anchors[interval], self.anchors[interval + 1]
        d_first, d_last = self.at_anchors[row, interval], self.at_anchors[row, interval + 1]
        steps: list[tuple[np.ndarray, np.ndarray]] = []
        while len(row):
            motion = self.travelled[row, last] - self.travelled[row, first]
            near = ~((d_first + d_last - motion) / 2.0 >= threshold[row])
            single = last - first == 1
            steps.append((row[near & single], first[near & single]))
            row, first, last, d_first, d_last = (x[near & ~single] for x in (row, first, last, d_first, d_last))
            middle = (first + last) // 2
            d_middle = self._gaps(row, middle)
            row = np.tile(row, 2)
            first, last = np.concatenate([first, middle]), np.concatenate([middle, last])
            d_first, d_last = np.concatenate([d_first, d_middle]), np.concatenate([d_middle, d_last])
        return _runs(*(np.concatenate(part) for part in zip(*steps, strict=True)))


def _runs(rows: np.ndarray, steps: np.ndarray) -> dict[int, list[tuple[int, int]]]:
    """Merges adjacent single steps (m,) of rows (m,) into runs (first sample, last sample), by row."""
    order = np.lexsort((steps, rows))
    rows, steps = rows[order], steps[order]
    broken = (np.diff(rows) != 0) | (np.diff(steps) != 1)
    begins, ends = np.append(True, broken)[: len(rows)], np.append(broken, True)[: len(rows)]
    runs: dict[int, list[tuple[int, int]]] = {}
    for row, first, last in zip(rows[begins].tolist(), steps[begins].tolist(), steps[ends].tolist(), strict=True):
        runs.setdefault(row, []).append((first, last + 1))
    return runs
