"""Lower bounds of distances from the boxes around parts, for many pairs at once.

The distance of two bodies changes no faster than their points move. So between two looks with distances d0 and d1, or
lower bounds of them, and a bound m on the relative motion, the distance is nowhere below (d0 + d1 - m) / 2.
"""

import numpy as np

from hmap_core.validation.geometry import Boxes, box_gap
from hmap_core.validation.pairs import Pair
from hmap_core.validation.world import World

STRIDE = 16  # samples between two looks at every pair; only stretches that these do not clear are looked at again
AT_ONCE = 4096  # boxes that are compared together; their numbers fit in a processor's cache


class PartBoxes:
    """The boxes around all parts of a world at all samples."""

    def __init__(self, world: World):
        self._samples = world.samples
        self._row = {part: i for i, part in enumerate(world.parts)}
        tracks = [world.tracks[part] for part in world.parts]
        self._boxes = Boxes.join([Boxes.around(track.part.solid, track.R, track.p) for track in tracks])

    def rows(self, pairs: list[Pair]) -> tuple[np.ndarray, np.ndarray]:
        """Which parts (n,) and (n,) the pairs consist of, as :meth:`gaps` takes them."""
        a, b = [self._row[pair.a] for pair in pairs], [self._row[pair.b] for pair in pairs]
        return np.array(a, int), np.array(b, int)

    def gaps(self, a: np.ndarray, b: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Lower bounds (n,) of the distances of the parts a (n,) from b (n,) at samples (n,); -inf where unknown."""
        a, b = a * self._samples + samples, b * self._samples + samples
        blocks = [slice(i, i + AT_ONCE) for i in range(0, len(a), AT_ONCE)]
        gaps = [box_gap(self._boxes[a[block]], self._boxes[b[block]]) for block in blocks]
        return np.concatenate(gaps) if gaps else np.zeros(0)


class Bounds:
    """Lower bounds of the distances of n pairs that move.

    Attributes:
        anchors: (A,) samples, the first and last among them, at which the boxes of all pairs are compared.
        at_anchors: (n, A) what that says; -inf where the boxes overlap.
        travelled: (n, N) bound in metres on the relative motion of the two from the start to each sample.
    """

    def __init__(self, world: World, boxes: PartBoxes, pairs: list[Pair]):
        self._boxes = boxes
        self._a, self._b = boxes.rows(pairs)
        self.anchors = np.unique(np.append(np.arange(0, world.samples, STRIDE), world.samples - 1))
        grid = np.meshgrid(np.arange(len(pairs)), self.anchors, indexing="ij")
        self.at_anchors = self._gaps(*(index.ravel() for index in grid)).reshape(len(pairs), len(self.anchors))
        self.travelled = np.zeros((len(pairs), world.samples))
        np.cumsum([pair.motion for pair in pairs], axis=1, out=self.travelled[:, 1:])

    def _gaps(self, rows: np.ndarray, samples: np.ndarray) -> np.ndarray:
        return self._boxes.gaps(self._a[rows], self._b[rows], samples)

    def suspicious(self, threshold: np.ndarray) -> dict[int, list[tuple[int, int]]]:
        """Where the bounds do not show that a pair's distance stays at or above its threshold (n,) in metres.

        Stretches between anchors are halved, down to single steps, as long as the bounds do not clear them.

        Returns:
            runs of steps (first and last sample) by the pair's place in the list; pairs that are clear are left out.
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
    """Single steps (m,) of rows (m,) as runs of adjacent ones (first and last sample) by row."""
    order = np.lexsort((steps, rows))
    rows, steps = rows[order], steps[order]
    broken = (np.diff(rows) != 0) | (np.diff(steps) != 1)
    begins, ends = np.append(True, broken)[: len(rows)], np.append(broken, True)[: len(rows)]
    runs: dict[int, list[tuple[int, int]]] = {}
    for row, first, last in zip(rows[begins].tolist(), steps[begins].tolist(), steps[ends].tolist(), strict=True):
        runs.setdefault(row, []).append((first, last + 1))
    return runs
