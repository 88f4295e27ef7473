"""What moves the object: the protocol of manipulators, and fingers that are points, without an arm."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hmap_core.baselines.cmgmp.modes import tangents
from hmap_core.baselines.cmgmp.problem import ObjectProblem
from hmap_core.transforms import apply

TRIED = 20  # relocations at one pose, as in the authors' program
STAYS = 0.5  # probability that a finger that may go elsewhere is lifted instead
ROOM = 0.9  # of a fingertip's radius that has to be free
PATCH = np.array([[1.0, 0.0], [-0.5, 0.866], [-0.5, -0.866]])  # three points stand for a soft fingertip


@dataclass(frozen=True)
class Placement:
    """Where fingers touch the object, in its frame.

    Attributes:
        points, normals: (n, 3) of the contact points; the normals point outwards.
        key: what the manipulator remembers of it.
    """

    points: np.ndarray
    normals: np.ndarray
    key: Any = ()


@dataclass(frozen=True)
class Relocation:
    """A new placement.

    Attributes:
        placement: afterwards.
        remaining: what touches the object meanwhile.
    """

    placement: Placement
    remaining: Placement


class Manipulator(Protocol):
    """Fingers that touch the object."""

    def relocations(self, placement: Placement | None, T: np.ndarray, rng: np.random.Generator) -> Iterator[Relocation]:
        """Yield random relocations with the object at T (7,), from a placement or none."""
        ...

    def settled(self, placement: Placement, T: np.ndarray, rng: np.random.Generator) -> Placement | None:
        """The placement, if it can be reached with the object at T (7,)."""
        ...

    def free(self, placement: Placement, T: np.ndarray) -> bool:
        """Whether the fingers are free with the object at T (7,)."""
        ...

    def followed(self, placement: Placement, poses: np.ndarray) -> tuple[Placement, np.ndarray]:
        """The placement at the end, and the poses (m, 7) of the object, as far as the manipulator follows them."""
        ...


NONE = Placement(np.zeros((0, 3)), np.zeros((0, 3)))


class PointFingers:
    """Implements :class:`Manipulator`: balls that are free to go anywhere.

    Args:
        problem: the object among its obstacles.
        points, normals: (N, 3) of the surface that may be touched, object frame.
        count: number of fingers.
        radius: of a fingertip.
        patch: whether a finger touches at three points round its middle.
    """

    def __init__(
        self, problem: ObjectProblem, points: np.ndarray, normals: np.ndarray, count: int, radius: float, patch: bool
    ):
        self._problem, self._points, self._normals = problem, points, normals
        self._count, self._radius, self._patch = count, radius, patch

    def relocations(self, placement: Placement | None, T: np.ndarray, rng: np.random.Generator) -> Iterator[Relocation]:
        """Yield relocations of one or more fingers to where there is room; some are lifted."""
        placed = [] if placement is None else list(placement.key)
        room = np.flatnonzero(self._room(np.arange(len(self._points)), T))
        for _ in range(TRIED if len(room) else 0):
            moved = int(rng.integers(1, self._count + 1))
            spare = self._count - len(placed)
            new = [int(rng.choice(room)) for _ in range(min(moved, spare)) if rng.random() >= STAYS]
            gone = rng.permutation(len(placed))[: max(0, moved - spare)].tolist()
            after = [int(rng.choice(room)) for _ in gone if rng.random() >= STAYS]
            remaining = [own for k, own in enumerate(placed) if k not in gone] + new
            keys = tuple(remaining + after)
            if keys:
                yield Relocation(self._placement(keys), self._placement(tuple(remaining)))

    def settled(self, placement: Placement, T: np.ndarray, rng: np.random.Generator) -> Placement | None:
        """The placement, if its fingers are free."""
        return placement if self.free(placement, T) else None

    def free(self, placement: Placement, T: np.ndarray) -> bool:
        """Whether no fingertip is in an obstacle."""
        return bool(self._room(np.array(placement.key, int), T).all())

    def _room(self, keys: np.ndarray, T: np.ndarray) -> np.ndarray:
        """At which of some points (n,) of the surface a fingertip is in no obstacle."""
        placed = apply(T, self._points[keys] + self._radius * self._normals[keys])
        room = np.ones(len(keys), bool)
        for obstacle in self._problem.obstacles:
            room &= (placed @ obstacle.normals.T - obstacle.offsets).max(axis=1) >= ROOM * self._radius
        return room

    def followed(self, placement: Placement, poses: np.ndarray) -> tuple[Placement, np.ndarray]:
        """All poses: nothing else moves."""
        return placement, poses

    def _placement(self, keys: tuple[int, ...]) -> Placement:
        points, normals = self._points[list(keys)], self._normals[list(keys)]
        if self._patch and keys:
            points, normals = patches(points, normals, self._radius)
        return Placement(points, normals, keys)


def patches(points: np.ndarray, normals: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (3 n, 3) round the middles (n, 3) of soft fingertips, and their normals."""
    first, second = tangents(normals)
    around = PATCH[:, :1] * first[:, None] + PATCH[:, 1:] * second[:, None]
    return (points[:, None] + radius * around).reshape(-1, 3), np.repeat(normals, len(PATCH), axis=0)
