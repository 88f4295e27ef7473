"""A collision model that grew from another: packs for the compiled code only what is new."""

from functools import cached_property

import numpy as np

from hmap_core.collision.scene_model import LEAST_SPEED, CollisionModel, Collisions

_OFFSETS = {"start": "vertices", "edge": "edges"}  # offsets into other arrays
_PAIRS = ("a", "b", "margin", "phases")


class GrownModel(CollisionModel):
    """Begins with the shapes and pairs of a model that is finished, and grows on its own."""

    def __init__(self, base: "BaseModel"):
        super().__init__(list(base.hulls), list(base.frames), list(base.names), list(base.pairs), list(base.speeds))
        self._base = base

    def arrays(self) -> Collisions:
        """As :meth:`CollisionModel.arrays`."""
        base = self._base.packed
        shapes, pairs = len(self._base.hulls), len(self._base.pairs)
        new = CollisionModel(self.hulls[shapes:], self.frames[shapes:], [], [], self.speeds[shapes:]).arrays()
        merged = {}
        for name in Collisions._fields:
            a, b = getattr(base, name), getattr(new, name)
            if name in _OFFSETS:
                b = b[1:] + len(getattr(base, _OFFSETS[name]))
            merged[name] = np.concatenate([a, b])
        for name, column in zip(_PAIRS, zip(*self.pairs[pairs:], strict=True), strict=False):
            merged[name] = np.concatenate([getattr(base, name), column]).astype(getattr(base, name).dtype)
        a, b, speed = merged["a"], merged["b"], merged["speed"]
        merged["closing"] = np.maximum(np.maximum(speed[a], speed[b]), LEAST_SPEED)
        return Collisions(**merged)


class BaseModel(CollisionModel):
    """A model that others grow from; it must not grow once one has."""

    @cached_property
    def packed(self) -> Collisions:
        """Its arrays, packed once."""
        return self.arrays()
