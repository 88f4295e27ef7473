"""A collision model that grew from another: packs for the compiled code only what is new."""

from functools import cached_property

import numpy as np

from hmap_core.collision.scene_model import LEAST_SPEED, CollisionModel, Collisions


class BaseModel(CollisionModel):
    """A model that others grow from; it must not grow any more once it was packed."""

    @cached_property
    def packed(self) -> Collisions:
        """Its arrays, packed once."""
        return super().arrays()

    def arrays(self) -> Collisions:
        """As :meth:`CollisionModel.arrays`."""
        return self.packed


class GrownModel(CollisionModel):
    """Begins with the shapes and pairs of a model that is finished, and grows on its own."""

    def __init__(self, base: BaseModel):
        super().__init__(list(base.hulls), list(base.frames), list(base.names), list(base.pairs), list(base.speeds))
        self._base = base

    def arrays(self) -> Collisions:
        """As :meth:`CollisionModel.arrays`."""
        base, S, P = self._base.packed, len(self._base.hulls), len(self._base.pairs)
        new = CollisionModel(self.hulls[S:], self.frames[S:], self.names[S:], [], self.speeds[S:]).arrays()
        speed = np.concatenate([base.speed, new.speed])
        a, b, margin, phases, closing = _packed_pairs(self.pairs[P:], speed)
        added = new._replace(
            start=new.start[1:] + len(base.vertices), edge=new.edge[1:] + len(base.edges),
            a=a, b=b, margin=margin, phases=phases, closing=closing,
        )  # fmt: skip
        return Collisions(*map(np.concatenate, zip(base, added, strict=True)))


def _packed_pairs(pairs: list[tuple[int, int, float, int]], speed: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shapes a, b (P,), margin (P,), phases (P,) and closing (P,) of pairs, as in :class:`Collisions`."""
    a, b, margin, phases = zip(*pairs, strict=True) if pairs else ((),) * 4
    a, b = np.array(a, np.int64), np.array(b, np.int64)
    closing = np.maximum(speed[a] + speed[b], LEAST_SPEED)
    return a, b, np.array(margin, float), np.array(phases, np.int64), closing
