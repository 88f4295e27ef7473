"""Which parts come near each other, by boxes round them: what the judge leaves out in worlds of many parts."""

from collections.abc import Iterator, Mapping

import numpy as np

from hmap_core.validation.world import Part, World

WINDOW = 16  # steps for which a part has one box
SORTED = 1_000  # pairs that are sorted at first
AT_ONCE = 2_000_000  # pairs of boxes that are compared together


class SweptBoxes:
    """Boxes that parts do not leave within windows of time, in world axes.

    Args:
        world: the plan.
        motion: bound (N-1,) on the motion of any point of each part in each step, m.

    Attributes:
        lower, upper: (W, P, 3) corners of the box of each part in each window, m.
    """

    def __init__(self, world: World, motion: Mapping[Part, np.ndarray]):
        self._parts, self._check_time = world.parts, world.check_time
        starts = np.arange(0, max(world.samples - 1, 1), WINDOW)
        ends = np.append(starts[1:], world.samples - 1)
        shape = len(starts), len(self._parts), 3
        self.lower, self.upper = np.empty(shape), np.empty(shape)
        for i, part in enumerate(self._parts):
            track = world.tracks[part]
            low, high = world.boxes.spans[i]
            if track.still or world.samples < 2:
                self.lower[:, i], self.upper[:, i] = low[0], high[0]
                continue
            room = 0.5 * np.maximum.reduceat(motion[part], starts)[:, None]  # between two samples
            self.lower[:, i] = np.minimum(np.minimum.reduceat(low, starts), low[ends]) - room
            self.upper[:, i] = np.maximum(np.maximum.reduceat(high, starts), high[ends]) + room

    def pairs(self, reach: float, frozen: np.ndarray) -> np.ndarray:
        """Pairs of parts of different links and bodies that come nearer to each other than ``reach``.

        Args:
            reach: m.
            frozen: (P,) whether a part never moves; two of these are no pair.

        Returns:
            (m, 2) numbers of parts, the smaller one first, in order; some may stay farther apart.
        """
        if not self._parts:
            return np.zeros((0, 2), int)
        owners = [(part.holder, part.link) for part in self._parts]
        first = np.array([i for i, owner in enumerate(owners) if i == 0 or owner != owners[i - 1]])
        last = np.append(first[1:], len(owners))
        stands = np.logical_and.reduceat(frozen, first)
        found = []
        for w, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True)):
            self._check_time()
            low, high = np.minimum.reduceat(lower, first), np.maximum.reduceat(upper, first)
            near = np.triu(_apart(low, high, low, high) <= reach, 1) & ~(stands[:, None] & stands)
            if w > 0:
                moved = ((lower != self.lower[w - 1]) | (upper != self.upper[w - 1])).any(axis=1)
                changed = np.logical_or.reduceat(moved, first)
                near &= changed[:, None] | changed
            for g, h in np.argwhere(near).tolist():
                a, b = np.arange(first[g], last[g]), np.arange(first[h], last[h])
                a = a[_apart(lower[a], upper[a], low[h : h + 1], high[h : h + 1])[:, 0] <= reach]
                b = b[_apart(lower[b], upper[b], low[g : g + 1], high[g : g + 1])[:, 0] <= reach]
                for some in np.array_split(a, len(a) * len(b) // AT_ONCE + 1):
                    i, j = np.nonzero(_apart(lower[some], upper[some], lower[b], upper[b]) <= reach)
                    found.append(some[i] * len(owners) + b[j])
        numbers = np.unique(np.concatenate(found)) if found else np.zeros(0, int)
        return np.column_stack(np.divmod(numbers, len(owners)))


def _apart(lower_a: np.ndarray, upper_a: np.ndarray, lower_b: np.ndarray, upper_b: np.ndarray) -> np.ndarray:
    """Distances (n, m) of boxes (n, 3) from boxes (m, 3), m."""
    square = np.zeros((len(lower_a), len(lower_b)))
    for x in range(3):
        gap = np.maximum(lower_b[:, x] - upper_a[:, x, None], lower_a[:, x, None] - upper_b[:, x])
        square += np.square(np.maximum(gap, 0.0))
    return np.sqrt(square)


def nearest_first(
    world: World, parts: np.ndarray, others: np.ndarray, k: int
) -> Iterator[tuple[float, tuple[int, int]]]:
    """All pairs of some parts with others, the nearest boxes first.

    Args:
        world: the plan.
        parts, others: (n,) and (m,) numbers of parts.
        k: the sample.

    Yields:
        A lower bound on the distance in metres, and the numbers of the two parts.
    """
    world.check_time()
    if not len(parts) or not len(others):
        return
    bounds = _apart(*world.boxes.at(parts, k), *world.boxes.at(others, k)).ravel()
    far = np.partition(bounds, SORTED)[SORTED] if len(bounds) > SORTED else np.inf
    for some in (bounds <= far, bounds > far):  # seldom more than the first few are asked for
        pairs = np.flatnonzero(some)
        pairs = pairs[np.argsort(bounds[pairs], kind="stable")]
        one, other = np.divmod(pairs, len(others))
        yield from zip(
            bounds[pairs].tolist(), zip(parts[one].tolist(), others[other].tolist(), strict=True), strict=True
        )
