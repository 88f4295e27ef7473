"""Shapes that hang on the frames of a problem, and the pairs of them that must keep a distance."""

from collections import namedtuple
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.collision.convex import ConvexSet, bounding_sphere

# The arrays of a CollisionModel as the compiled code takes them.
#   vertices (V,3), start (S+1,), radius (S,), center (S,3), bound (S,), low/high (S,3): box round the shape, own frame
#   frame (S,): frame that carries it; a, b (P,): shapes of a pair; margin (P,): m; phases (P,): bit k set = in phase k
#   speed (S,): how much farther than the chain's reach says a point of the shape may move; 0 in the world frame
Collisions = namedtuple("Collisions", "vertices start radius center bound low high frame a b margin phases speed")

ALL_PHASES = -1  # every bit


@dataclass
class CollisionModel:
    """Grows shape by shape and pair by pair; :meth:`arrays` hands it to the compiled code.

    Shapes are convex pieces (vertices (n, 3), radius) in the frame that carries them, each with the name of the part it
    belongs to.
    """

    hulls: list[tuple[np.ndarray, float, np.ndarray, float]] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    pairs: list[tuple[int, int, float, int]] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)

    def add(self, name: str, vertices: np.ndarray, radius: float, frame: int, sphere=None, speed: float = 1.0) -> int:
        """Adds a shape and returns its number.

        Args:
            sphere: (center (3,), radius) that bounds it, where that is known.
            speed: bound on its motion as a multiple of what the chain's reach says; 1 for the links themselves.
        """
        if sphere is None:
            center, bound = bounding_sphere(vertices)
            sphere = center, bound + radius
        self.hulls.append((np.ascontiguousarray(vertices, float), float(radius), *sphere))
        self.frames.append(frame)
        self.names.append(name)
        self.speeds.append(speed if frame else 0.0)
        return len(self.hulls) - 1

    def add_set(self, name: str, shapes: ConvexSet, frame: int, speed: float = 1.0) -> list[int]:
        """Adds all shapes of a set given in the frame's coordinates."""
        return [
            self.add(name, shapes.hull(s), shapes.radius[s], frame, (shapes.center[s], shapes.bound[s]), speed)
            for s in range(len(shapes))
        ]

    def copy(self) -> "CollisionModel":
        """A model of the same shapes and pairs that grows on its own."""
        return CollisionModel(
            list(self.hulls), list(self.frames), list(self.names), list(self.pairs), list(self.speeds)
        )

    def keep_apart(self, A: Iterable[int], B: Sequence[int], margin: float, phases: int = ALL_PHASES) -> None:
        """Every shape of A keeps ``margin`` metres from every one of B in the phases of the bit mask."""
        self.pairs.extend((a, b, margin, phases) for a in A for b in B)

    def arrays(self) -> Collisions:
        spans = [hull[0] for hull in self.hulls]
        radius = np.array([hull[1] for hull in self.hulls])
        low = np.array([v.min(0) for v in spans]).reshape(-1, 3) - radius[:, None]
        high = np.array([v.max(0) for v in spans]).reshape(-1, 3) + radius[:, None]
        return Collisions(
            np.concatenate(spans), np.cumsum([0, *(len(v) for v in spans)]).astype(np.int64), radius,
            np.array([hull[2] for hull in self.hulls]), np.array([hull[3] for hull in self.hulls]), low, high,
            np.array(self.frames, np.int64),
            np.array([p[0] for p in self.pairs], np.int64), np.array([p[1] for p in self.pairs], np.int64),
            np.array([p[2] for p in self.pairs], float), np.array([p[3] for p in self.pairs], np.int64),
            np.array(self.speeds),
        )  # fmt: skip

    def pair_name(self, pair: int) -> tuple[str, str]:
        a, b = self.pairs[pair][:2]
        return self.names[a], self.names[b]
