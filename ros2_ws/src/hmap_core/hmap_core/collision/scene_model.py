"""Collision model of a problem: shapes on its frames, and pairs of shapes that must keep a minimum distance."""

from collections import namedtuple
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.collision.convex import ConvexSet, bounding_sphere
from hmap_core.collision.edges import NO_EDGES

# The arrays of a CollisionModel in the form that compiled code needs; lengths in metres.
#   vertices (V,3), start (S+1,), radius (S,), center (S,3), bound (S,): as in ConvexSet, in the frame of the shape
#   low, high (S,3): corners of the bounding box of a shape, in its frame
#   frame (S,): index of the frame that carries the shape
#   a, b (P,): shapes of a pair; min_distance (P,); phases (P,): bit k is set if the pair counts in phase k
#   speed (S,): bound on the motion of a shape relative to the bound by the chain's reach; 0 in the world frame
#   edges, edge (S+1,): hull edges of shape s are edges[edge[s]:edge[s+1]], see hmap_core.collision.edges
#   closing (P,): bound on the motion of both shapes of a pair relative to the bound by the chain's reach
Collisions = namedtuple(
    "Collisions", "vertices start radius center bound low high frame a b min_distance phases speed edges edge closing"
)

PER_PAIR = "a", "b", "min_distance", "phases", "closing"  # the arrays (P,)
ALL_PHASES = -1  # all bits are set
LEAST_SPEED = 1e-6  # speed of a pair without motion, a positive divisor


@dataclass
class CollisionModel:
    """Shapes and pairs, added one by one; :meth:`arrays` packs them for the compiled code.

    Each shape is a swept hull in the frame that carries it, with the name of the body or link that it belongs to.

    Attributes:
        hulls: vertices (n, 3), sphere radius, centre and radius of the bounding sphere, and edges of each shape.
        frames: index of the frame of each shape.
        names: name of the body or link of each shape.
        pairs: two shape indices, minimum distance (m) and bit mask of phases of each pair.
        speeds: bound on the motion of each shape relative to the bound by the chain's reach.
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
        """Adds a shape.

        Args:
            name: of the body or link.
            vertices: (n, 3) in the frame, m.
            radius: of the sweeping sphere, m.
            frame: index of the frame that carries the shape; 0 is the world.
            sphere: centre (3,) and radius of a bounding sphere, if known.
            speed: bound on its motion relative to the bound by the chain's reach; 1 for links.
            edges: of the hull (see :mod:`hmap_core.collision.edges`), if known.

        Returns:
            Index of the shape.
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
        """Adds all shapes of a set that is given in the frame; returns their indices. Arguments as of :meth:`add`."""
        return [
            self.add(
                name, shapes.hull(s), shapes.radius[s], frame, (shapes.center[s], shapes.bound[s]), speed,
                shapes.edges[s],
            )
            for s in range(len(shapes))
        ]  # fmt: skip

    def copy(self) -> "CollisionModel":
        """A copy that can be extended independently."""
        return CollisionModel(
            list(self.hulls), list(self.frames), list(self.names), list(self.pairs), list(self.speeds)
        )

    def keep_apart(self, A: Iterable[int], B: Sequence[int], min_distance: float, phases: int = ALL_PHASES) -> None:
        """Adds the pairs of all shapes of A with all shapes of B.

        Args:
            A, B: shape indices.
            min_distance: m.
            phases: bit mask of the phases in which the pairs count.
        """
        self.pairs.extend((a, b, min_distance, phases) for a in A for b in B)

    def arrays(self) -> Collisions:
        """Packs the model for the compiled code."""
        vertices, radii, center, bound, edges = zip(*self.hulls, strict=True) if self.hulls else ((),) * 5
        sizes = [len(v) for v in vertices]
        points = np.concatenate([np.zeros((0, 3)), *vertices])
        start = np.cumsum([0, *sizes]).astype(np.int64)
        radius = np.array(radii, float)
        low, high = (f.reduceat(points, start[:-1]) if sizes else points for f in (np.minimum, np.maximum))
        first, second, min_distance, phases = zip(*self.pairs, strict=True) if self.pairs else ((),) * 4
        a, b, speed = np.array(first, np.int64), np.array(second, np.int64), np.array(self.speeds, float)
        return Collisions(
            points, start, radius, np.array(center, float).reshape(-1, 3), np.array(bound, float),
            low - radius[:, None], high + radius[:, None], np.array(self.frames, np.int64),
            a, b, np.array(min_distance, float), np.array(phases, np.int64), speed,
            np.concatenate([NO_EDGES, *edges]), np.cumsum([0, *(len(e) for e in edges)]).astype(np.int64),
            np.maximum(speed[a] + speed[b], LEAST_SPEED),
        )  # fmt: skip

    def pair_name(self, pair: int) -> tuple[str, str]:
        """Names of the two bodies or links of a pair."""
        a, b = self.pairs[pair][:2]
        return self.names[a], self.names[b]
