"""Shapes that hang on the frames of a problem, and the pairs of them that must keep a distance."""

from collections import namedtuple
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.collision.convex import ConvexSet, bounding_sphere
from hmap_core.collision.edges import NO_EDGES

# The arrays of a CollisionModel as the compiled code takes them.
#   vertices (V,3), start (S+1,), radius (S,), center (S,3), bound (S,), low/high (S,3): box round the shape, own frame
#   frame (S,): frame that carries it; a, b (P,): shapes of a pair; minimum distance (P,): m; phases (P,): bit k set
# = in phase k
#   speed (S,): how much farther than the chain's reach says a point of the shape may move; 0 in the world frame
#   edges, edge (S+1,): hull edges of shape s are edges[edge[s]:edge[s+1]], see hmap_core.collision.edges
#   closing (P,): how far both shapes of a pair together may move per metre that the chain's reach says
Collisions = namedtuple(
    "Collisions", "vertices start radius center bound low high frame a b min_distance phases speed edges edge closing"
)

ALL_PHASES = -1  # every bit
LEAST_SPEED = 1e-6  # of a pair that never moves, so that it can be divided by


@dataclass
class CollisionModel:
    """Grows shape by shape and pair by pair; :meth:`arrays` hands it to the compiled code.

    Shapes are convex pieces (vertices (n, 3), radius) in the frame that carries them, each with the name of the part it
    belongs to.
    """

    hulls: list[tuple[np.ndarray, float, np.ndarray, float, np.ndarray]] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    pairs: list[tuple[int, int, float, int]] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)

    def add(
        self,
        name: str,
        vertices: np.ndarray,
        radius: float,
        frame: int,
        sphere: tuple[np.ndarray, float] | None = None,
        speed: float = 1.0,
        edges: np.ndarray = NO_EDGES,
    ) -> int:
        """Adds a shape and returns its number.

        Args:
            sphere: (center (3,), radius) that bounds it, where that is known.
            speed: bound on its motion as a multiple of what the chain's reach says; 1 for the links themselves.
            edges: the hull's edges (see :mod:`hmap_core.collision.edges`), where they are known.
        """
        if sphere is None:
            center, bound = bounding_sphere(vertices)
            sphere = center, bound + radius
        self.hulls.append((np.ascontiguousarray(vertices, float), float(radius), *sphere, edges))
        self.frames.append(frame)
        self.names.append(name)
        self.speeds.append(speed if frame else 0.0)
        return len(self.hulls) - 1

    def add_set(self, name: str, shapes: ConvexSet, frame: int, speed: float = 1.0) -> list[int]:
        """Adds all shapes of a set given in the frame's coordinates."""
        return [
            self.add(
                name, shapes.hull(s), shapes.radius[s], frame, (shapes.center[s], shapes.bound[s]), speed,
                shapes.edges[s],
            )
            for s in range(len(shapes))
        ]  # fmt: skip

    def copy(self) -> "CollisionModel":
        """A model of the same shapes and pairs that grows on its own."""
        return CollisionModel(
            list(self.hulls), list(self.frames), list(self.names), list(self.pairs), list(self.speeds)
        )

    def keep_apart(self, A: Iterable[int], B: Sequence[int], min_distance: float, phases: int = ALL_PHASES) -> None:
        """Every shape of A keeps ``min_distance`` metres from every one of B in the phases of the bit mask."""
        self.pairs.extend((a, b, min_distance, phases) for a in A for b in B)

    def arrays(self) -> Collisions:
        vertices, radius, center, bound, edges = zip(*self.hulls, strict=True) if self.hulls else ((),) * 5
        sizes = [len(v) for v in vertices]
        points = np.concatenate([np.zeros((0, 3)), *vertices])
        start = np.cumsum([0, *sizes]).astype(np.int64)
        radius = np.array(radius, float)
        low, high = (f.reduceat(points, start[:-1]) if sizes else points for f in (np.minimum, np.maximum))
        a, b, min_distance, phases = zip(*self.pairs, strict=True) if self.pairs else ((),) * 4
        a, b, speed = np.array(a, np.int64), np.array(b, np.int64), np.array(self.speeds, float)
        return Collisions(
            points, start, radius, np.array(center, float).reshape(-1, 3), np.array(bound, float),
            low - radius[:, None], high + radius[:, None], np.array(self.frames, np.int64),
            a, b, np.array(min_distance, float), np.array(phases, np.int64), speed,
            np.concatenate([NO_EDGES, *edges]), np.cumsum([0, *(len(e) for e in edges)]).astype(np.int64),
            np.maximum(speed[a] + speed[b], LEAST_SPEED),
        )  # fmt: skip

    def pair_name(self, pair: int) -> tuple[str, str]:
        a, b = self.pairs[pair][:2]
        return self.names[a], self.names[b]
