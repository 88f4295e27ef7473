"""Collision models that extend another model; only the additions are packed for the compiled code."""

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike

from hmap_core.collision.scene_model import ALL_PHASES, LEAST_SPEED, CollisionModel, Collisions
from hmap_core.deadline import check_time

MANY_PAIRS = 50_000  # that take so long to pack
MANY_SHAPES = 64  # whose pairs with one other take so long that the clock is looked at in between


class _TimedModel(CollisionModel):
    """A model that looks at the clock while many pairs are added."""

    def keep_apart(self, A: Iterable[int], B: Sequence[int], min_distance: float, phases: int = ALL_PHASES) -> None:
        """As :meth:`CollisionModel.keep_apart`."""
        if len(B) < MANY_SHAPES:
            super().keep_apart(A, B, min_distance, phases)
            return
        for a in A:
            check_time()
            super().keep_apart((a,), B, min_distance, phases)


class BaseModel(_TimedModel):
    """A model that others extend. It must not change after it was packed."""

    @cached_property
    def packed(self) -> Collisions:
        """Its arrays, packed once."""
        if len(self.pairs) < MANY_PAIRS:
            return super().arrays()
        return _extended(CollisionModel().arrays(), self, 0, 0)

    def arrays(self) -> Collisions:
        """As :meth:`CollisionModel.arrays`."""
        return self.packed


class GrownModel(_TimedModel):
    """A model that starts with the shapes and pairs of a finished model, and is extended independently of it.

    Args:
        base: the finished model.
    """

    def __init__(self, base: BaseModel):
        super().__init__(list(base.hulls), list(base.frames), list(base.names), list(base.pairs), list(base.speeds))
        self._base = base
        self._packed: tuple[tuple[int, int], Collisions] | None = None

    def arrays(self) -> Collisions:
        """As :meth:`CollisionModel.arrays`; packed again only after shapes or pairs were added."""
        size = len(self.hulls), len(self.pairs)
        if self._packed is None or self._packed[0] != size:
            base = self._base
            self._packed = size, _extended(base.packed, self, len(base.hulls), len(base.pairs))
        return self._packed[1]


def _extended(base: Collisions, model: CollisionModel, S: int, P: int) -> Collisions:
    """The arrays of a model whose first S shapes and P pairs are packed in ``base``; looks at the clock in between."""
    check_time()
    vertices, radius, center, bound, edges = _columns(model.hulls[S:], 5)
    check_time()
    a, b, min_distance, phases = _pairs(base, model.pairs[P:])
    points, start = np.concatenate([base.vertices, *vertices]), _ends(base.vertices, vertices)
    low, high = (f.reduceat(points, start[:-1]) for f in (np.minimum, np.maximum))
    swept = np.array(radius, float)[:, None]
    speed = _longer(base.speed, model.speeds[S:])
    check_time()
    return Collisions(
        points,
        _longer(base.start, start[1:]),
        _longer(base.radius, radius),
        _longer(base.center, center),
        _longer(base.bound, bound),
        np.concatenate([base.low, low - swept]),
        np.concatenate([base.high, high + swept]),
        _longer(base.frame, model.frames[S:]),
        np.concatenate([base.a, a]),
        np.concatenate([base.b, b]),
        np.concatenate([base.min_distance, min_distance]),
        np.concatenate([base.phases, phases]),
        speed,
        np.concatenate([base.edges, *edges]),
        _longer(base.edge, _ends(base.edges, edges)[1:]),
        np.concatenate([base.closing, np.maximum(speed[a] + speed[b], LEAST_SPEED)]),
    )


def _pairs(base: Collisions, pairs: list[tuple]) -> tuple[np.ndarray, ...]:
    """The columns (P,) of pairs, of the types that ``base`` has."""
    types = (base.a.dtype, base.b.dtype, base.min_distance.dtype, base.phases.dtype)
    parts = []
    for k in range(0, max(len(pairs), 1), MANY_PAIRS):
        check_time()
        columns = _columns(pairs[k : k + MANY_PAIRS], 4)
        parts.append([np.array(column, kind) for column, kind in zip(columns, types, strict=True)])
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def _columns(rows: list[tuple], count: int) -> tuple[tuple, ...]:
    return tuple(zip(*rows, strict=True)) if rows else ((),) * count


def _ends(array: np.ndarray, added: tuple[np.ndarray, ...]) -> np.ndarray:
    """End offsets of an array and of the arrays that are appended to it."""
    return np.array([*accumulate(map(len, added), initial=len(array))], np.int64)


def _longer(array: np.ndarray, rows: ArrayLike) -> np.ndarray:
    """Appends rows to an array."""
    return np.concatenate([array, np.array(rows, array.dtype).reshape(-1, *array.shape[1:])])
