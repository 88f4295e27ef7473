"""A collision model that grew from another: packs for the compiled code only what is new."""

from functools import cached_property

import numpy as np

from hmap_core.collision.edges import NO_EDGES
from hmap_core.collision.scene_model import CollisionModel, Collisions

_PER_PAIR = ("a", "b", "margin", "phases", "closing")
_POINT = np.zeros((1, 3)), 0.0, np.zeros(3), 0.0, NO_EDGES  # stands in for a shape that is packed already


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
        base, S = self._base.packed, len(self._base.hulls)
        new = CollisionModel(
            [_POINT] * S + self.hulls[S:], self.frames, self.names, self.pairs[len(self._base.pairs) :], self.speeds
        ).arrays()
        added = {name: array if name in _PER_PAIR else array[S:] for name, array in new._asdict().items()}
        added["start"] = new.start[S + 1 :] - S + len(base.vertices)
        added["edge"] = new.edge[S + 1 :] + len(base.edges)
        added["edges"] = new.edges
        return Collisions(*(np.concatenate([getattr(base, name), added[name]]) for name in Collisions._fields))
