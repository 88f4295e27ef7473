"""The problem of CMGMP: one object, fixed obstacles, and fingers that touch the object at points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from hmap_core.baselines.cmgmp.polyhedra import MOST, Polyhedron, manifold
from hmap_core.transforms import distance, rotation_matrix

TOLERANCE = 0.004  # of the object's size: what is nearer touches
CONTACTS_PER_PAIR = 4  # the farthest from each other


@dataclass(frozen=True)
class EnvironmentContact:
    """A point at which the object touches an obstacle, in the object's frame.

    Attributes:
        point: (3,); normal: (3,) unit vector into the object.
        gap: distance, negative inside.
        pair: numbers of the object's part and of the obstacle.
        label: by which the point is known as the object moves.
    """

    point: np.ndarray
    normal: np.ndarray
    gap: float
    pair: tuple[int, int]
    label: tuple[int, ...]


Normals = Mapping[tuple[int, int], np.ndarray]  # by the numbers of the object's part and of the obstacle


@dataclass(frozen=True)
class Touching:
    """Where the object touches obstacles at a pose.

    Attributes:
        contacts: the points.
        gap: distance to the nearest obstacle, negative inside.
        others: other normals (3,), world frame, that pairs may have which touch at a corner.
    """

    contacts: list[EnvironmentContact]
    gap: float
    others: Normals


@dataclass
class ObjectProblem:
    """Move an object by fingers among fixed obstacles, with the forces that hold it in balance.

    Attributes:
        name: for people.
        parts: the object's convex parts, in its frame.
        obstacles: in the world.
        start, goal: (7,) poses of the object.
        friction: Coulomb coefficient between object and obstacles.
        finger_friction: between object and fingers.
        weight: force of gravity on the object, downwards; centre: (3,) its centre of mass, object frame.
        lower, upper: (3,) positions that are sampled.
        turns: rotations that are sampled: an axis (3,), or None for all.
        translation_weight, turn_weight: of lengths and rad in the distance between two poses.
        longest, widest: largest translation, and turn in rad, of one extension.
        reached: distance to the goal that counts as reached.
        planar: the object stays on its support.
    """

    name: str
    parts: Sequence[Polyhedron]
    obstacles: Sequence[Polyhedron]
    start: np.ndarray
    goal: np.ndarray
    friction: float
    finger_friction: float
    weight: float
    lower: np.ndarray
    upper: np.ndarray
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turns: np.ndarray | None = None
    translation_weight: float = 1.0
    turn_weight: float = 1.0
    longest: float = 1.0
    widest: float = 1.0
    reached: float = 0.1
    planar: bool = False

    def __post_init__(self):
        vertices = np.concatenate([part.vertices for part in self.parts])
        self.size = float(np.linalg.norm(vertices - self.centre, axis=1).max())
        self.tolerance = TOLERANCE * self.size
        self._points, self._gaps = np.zeros((MOST, 3)), np.zeros(MOST)
        self._labels = np.zeros((MOST, 3), np.int64)
        self._boxes = tuple(
            np.array([f(o.vertices, axis=0) for o in self.obstacles]).reshape(-1, 3) for f in (np.min, np.max)
        )
        self._other, self._none = np.zeros(3), np.zeros(3)
        # the start may be a little inside of something
        self.deepest = min(-self.tolerance, self.contacts(self.start).gap - 0.1 * self.tolerance)

    def distance(self, T: np.ndarray, other: np.ndarray) -> float:
        """Weighted distance between two poses (7,)."""
        far, turn = distance(T, other)
        return self.translation_weight * far + self.turn_weight * turn

    def contacts(self, T: np.ndarray, normals: Normals = MappingProxyType({})) -> Touching:
        """Where the object at T (7,) touches obstacles.

        Args:
            normals: world normals (3,) by pair, to be preferred where a pair touches at a corner.
        """
        R, p = rotation_matrix(T), T[:3]
        found: list[EnvironmentContact] = []
        others: dict[tuple[int, int], np.ndarray] = {}
        nearest = np.inf
        for a, part in enumerate(self.parts):
            vertices = part.vertices @ R.T + p
            turned = part.normals @ R.T
            offsets = part.offsets + turned @ p
            directions = part.directions @ R.T
            low, high = vertices.min(axis=0) - self.tolerance, vertices.max(axis=0) + self.tolerance
            near = np.flatnonzero(((self._boxes[0] <= high) & (self._boxes[1] >= low)).all(axis=1))
            for b in near.tolist():
                obstacle = self.obstacles[b]
                count, normal, gap = manifold(
                    vertices, turned, offsets, part.edges, directions, *obstacle.arrays, self.tolerance,
                    normals.get((a, b), self._none), self._points, self._gaps, self._labels, self._other,
                )  # fmt: skip
                nearest = min(nearest, gap)
                if count:
                    own = (self._points[:count] - p) @ R
                    for k in _spread(own, CONTACTS_PER_PAIR):
                        label = a, b, *self._labels[k].tolist()
                        found.append(EnvironmentContact(own[k], normal @ R, float(self._gaps[k]), (a, b), label))
                    if self._other.any():
                        others[a, b] = self._other.copy()
        return Touching(found, float(nearest), others)


def _spread(points: np.ndarray, count: int) -> list[int]:
    """Numbers of up to ``count`` of the points (n, 3) that are far from each other."""
    if len(points) <= count:
        return list(range(len(points)))
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    far = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return sorted(chosen)
