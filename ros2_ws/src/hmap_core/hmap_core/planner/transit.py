"""Sampling-based search for a transit if optimisation alone finds none; the result is KOMO's first guess or final.

Two trees grow towards each other as in RRT-Connect (Kuffner and LaValle, ICRA 2000). They grow by straight motions of
the joints and by straight motions of the hand: a hand with a tool under a shelf can slide out, but hardly any joint
motion leads out of there. Both kinds extend as far as they are collision-free, which is checked between configurations
as well: small rotations of the joints move a long attached tool through thin boards.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.deadline import check_time
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.pair_blocks import PairChecks
from hmap_core.planner.hand_moves import HandMoves, fractions
from hmap_core.transforms import rotation_matrix

INTERVAL = 0.1  # rad, longest straight motion that is looked at as one
RANGE = 0.8  # rad, longest extension of a tree by a motion of the joints
HAND_RANGE = 0.3  # m, by a move of the hand
HAND_SHARE = 0.5  # of the extensions that are moves of the hand
AROUND = 0.2  # m beyond start and goal in which the hand is sent about
UNSEEN = 1e-3  # m that a pair may come nearer between two looks
SLACK = 1e-4  # m that minimum distances may be left by: configurations from inverse kinematics are that good
CHECKS = 20_000  # looks after which a search gives up, whatever the clock says
RUNS = 4  # searches, while all ways are longer than DETOUR times the straight one
DETOUR = 1.5
INTERVAL_LOOKS, HAND_LOOKS = 3, 3  # what an interval, and a configuration from inverse kinematics, cost in looks
SHORTCUTS = 200
MIN_SAVING = 0.02  # rad that a shortcut has to save
POINTS = 100  # of the path that is found, about
SHORTEST = 1e-9  # rad; a path that is shorter is none
SMOOTHINGS = 60  # times that its points move towards the middle of their neighbours


class TransitChecks:
    """Collision checks of joint motions, counted.

    Args:
        chain: what moves.
        cols: collision pairs with their minimum distances.
        mask: bit mask of the phases that count.

    Attributes:
        looks: what was checked so far, in configurations.
    """

    def __init__(self, chain: Chain, cols: Collisions, mask: int):
        self.chain, self._mask, self._all_masks = chain, mask, np.zeros(0, np.int64)
        self._pairs = PairChecks(chain, cols._replace(min_distance=cols.min_distance - SLACK))
        self.looks = 0

    def reached(self, path: np.ndarray) -> int:
        """How many of the configurations (m + 1, n) after the first are reached freely, straight from one to the
        next."""
        check_time()
        steps = self._before_hit(self._pairs.along(path[1:], self._masks(len(path) - 1), 0.0)[1])
        self.looks += len(path) - 1 + INTERVAL_LOOKS * steps
        path = path[: steps + 1]
        check_time()
        return self._before_hit(self._pairs.between(path, self._masks(steps), UNSEEN)[1])

    def line(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Configurations (m + 1, n) straight from a to b (n,), INTERVAL apart or less."""
        way = b - a
        return a + fractions(max(1, math.ceil(np.abs(way).max() / INTERVAL))) * way

    def straight(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the straight motion from a to b (n,) is free."""
        line = self.line(a, b)
        return self.reached(line) == len(line) - 1

    def hit(self, path: np.ndarray) -> np.ndarray:
        """Which intervals (m,) of a path (m + 1, n), straight between its configurations, are not free."""
        check_time()
        self.looks += INTERVAL_LOOKS * (len(path) - 1)
        return self._pairs.between(path, self._masks(len(path) - 1), UNSEEN)[1] >= 0

    def _masks(self, count: int) -> np.ndarray:
        if count > len(self._all_masks):
            self._all_masks = np.full(2 * count, self._mask, np.int64)
        return self._all_masks[:count]

    @staticmethod
    def _before_hit(pairs: np.ndarray) -> int:
        """How many come before the first of (M,) in which a pair is hit."""
        hits = (pairs >= 0).nonzero()[0]
        return int(hits[0]) if len(hits) else len(pairs)


class _Tree:
    """Configurations that are reached from a first one, and where the hand is in each."""

    def __init__(self, q: np.ndarray, moves: HandMoves):
        self._moves = moves
        self.configurations, self.hands, self._parents = q[None], moves.poses(q[None]), [-1]

    def add(self, path: np.ndarray, parent: int) -> int:
        """A branch of configurations (m, n); returns the number of its last one."""
        for _ in path:
            self._parents.append(parent)
            parent = len(self._parents) - 1
        self.configurations = np.concatenate([self.configurations, path])
        self.hands = np.concatenate([self.hands, self._moves.poses(path)])
        return parent

    def nearest(self, q: np.ndarray) -> int:
        return _nearest(self.configurations, q)

    def nearest_hand(self, point: np.ndarray) -> int:
        return _nearest(self.hands[:, :3], point)

    def branch(self, k: int) -> np.ndarray:
        """Configurations (m, n) from the first one to the k-th."""
        numbers = []
        while k >= 0:
            numbers.append(k)
            k = self._parents[k]
        return self.configurations[numbers[::-1]]


def _nearest(points: np.ndarray, point: np.ndarray) -> int:
    """Number of the nearest of some points (M, n) to another one (n,)."""
    apart = points - point
    return int(np.einsum("ij,ij->i", apart, apart).argmin())


# (checks, moves, start, goal, rng, deadline) -> configurations (m, n) of a free path, straight between them, or None
Connect = Callable[[TransitChecks, HandMoves, np.ndarray, np.ndarray, np.random.Generator, float], np.ndarray | None]


class TreeTransit:
    """Implements :class:`hmap_core.planner.protocols.TransitPlanner` by hmap's own trees: :func:`find_transit`."""

    def find_transit(
        self,
        moves: HandMoves,
        chain: Chain,
        cols: Collisions,
        mask: int,
        start: np.ndarray,
        goal: np.ndarray,
        rng: np.random.Generator,
        deadline: float,
    ) -> np.ndarray | None:
        """As :func:`find_transit`."""
        return find_transit(moves, chain, cols, mask, start, goal, rng, deadline)


def find_transit(
    moves: HandMoves, chain: Chain, cols: Collisions, mask: int, start: np.ndarray, goal: np.ndarray,
    rng: np.random.Generator, deadline: float, connect: Connect | None = None,
) -> np.ndarray | None:  # fmt: skip
    """Configurations (m, n) of a free joint path from start to goal (n,), short and smooth; None when none was found.

    Args:
        moves: of the hand, among the same things.
        chain, cols, mask: what moves, what keeps apart, and the bit mask of phases that counts.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which to give up.
        connect: finds a free path, which is then shortened and smoothed; None: hmap's own two trees.
    """
    free, ways = TransitChecks(chain, cols, mask), []
    if not free.straight(goal, goal):
        return None
    for _ in range(RUNS):
        free.looks = 0
        way = (connect or _connect)(free, moves, start, goal, rng, deadline)
        if way is None:
            break
        ways.append(_shortened(free, way, rng))
        if _length(ways[-1]) <= DETOUR * np.linalg.norm(goal - start):
            break
    return _smoothed(free, min(ways, key=_length)) if ways else None


def _connect(
    free: TransitChecks,
    moves: HandMoves,
    start: np.ndarray,
    goal: np.ndarray,
    rng: np.random.Generator,
    deadline: float,
) -> np.ndarray | None:
    """Configurations (m, n) from start to goal (n,), straight between them, in which the trees have met."""
    trees = _Tree(start, moves), _Tree(goal, moves)
    ends = np.concatenate([tree.hands[:, :3] for tree in trees])
    room = ends.min(axis=0) - AROUND, ends.max(axis=0) + AROUND
    grown, other = trees
    new: int | None = 0
    while free.looks < CHECKS and time.monotonic() < deadline:
        if new is not None:
            near = other.nearest(grown.configurations[new])
            line = free.line(other.configurations[near], grown.configurations[new])
            count = free.reached(line)
            if count == len(line) - 1:
                ways = grown.branch(new), other.branch(near)
                return np.concatenate([ways[0], ways[1][::-1]] if grown is trees[0] else [ways[1], ways[0][::-1]])
            if count > 0:
                other.add(line[count : count + 1], near)
        grown, other = other, grown
        new = _by_hand(free, moves, grown, room, rng) if rng.random() < HAND_SHARE else _by_joints(free, grown, rng)
    return None


def _by_joints(free: TransitChecks, tree: _Tree, rng: np.random.Generator) -> int | None:
    """Grows a tree towards a random configuration; returns the number of the new one, None where it cannot."""
    target = rng.uniform(free.chain.lower, free.chain.upper)
    near = tree.nearest(target)
    line = free.line(tree.configurations[near], target)[: int(RANGE / INTERVAL) + 1]
    count = free.reached(line)
    return tree.add(line[count : count + 1], near) if count > 0 else None


def _by_hand(free: TransitChecks, moves: HandMoves, tree: _Tree, room, rng: np.random.Generator) -> int | None:
    """Grows a tree by a move of the hand towards a random point of the room (two corners (3,)).

    Only along one, two or all three axes, of the world or of the hand: narrow places lie along one or the other.
    """
    point = rng.uniform(*room)
    near = tree.nearest_hand(point)
    hand = tree.hands[near]
    axes = np.eye(3) if rng.random() < 0.5 else rotation_matrix(hand)
    kept = rng.random(3) < 0.5
    kept[rng.integers(3)] = True
    way = axes @ (kept * ((point - hand[:3]) @ axes))
    way *= min(1.0, HAND_RANGE / np.linalg.norm(way))
    path = moves.along(tree.configurations[near], way, hand)
    free.looks += HAND_LOOKS * len(path)
    count = free.reached(path) if len(path) > 1 else 0
    return tree.add(path[1 : count + 1], near) if count > 0 else None


def _shortened(free: TransitChecks, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random shortcuts between points of the path."""
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        i, j = sorted(rng.integers(0, len(path) - 1, 2))
        a = path[i] + rng.random() * (path[i + 1] - path[i])
        b = path[j] + rng.random() * (path[j + 1] - path[j])
        there = np.concatenate([a[None], path[i + 1 : j + 1], b[None]])
        if i != j and _length(there) - np.linalg.norm(b - a) > MIN_SAVING and free.straight(a, b):
            path = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
    return path


def _length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _smoothed(free: TransitChecks, path: np.ndarray) -> np.ndarray:
    """The path with about POINTS points, its corners among them, moved between their neighbours where that is free."""
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    counts = np.maximum(1, np.ceil(POINTS * length / max(length.sum(), SHORTEST))).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(path, path[1:], counts, strict=False)]
    path = np.concatenate([*pieces, path[-1:]])
    for _ in range(SMOOTHINGS):
        moved = path.copy()
        moved[1:-1] = 0.5 * path[1:-1] + 0.25 * (path[:-2] + path[2:])
        hit = free.hit(moved)
        while hit.any():
            kept = np.append(hit, False) | np.append(False, hit)
            if np.array_equal(moved[kept], path[kept]):
                return path
            moved[kept] = path[kept]
            hit = free.hit(moved)
        path = moved
    return path


def resampled(path: np.ndarray, steps: int) -> np.ndarray:
    """``steps`` configurations (steps, n) evenly along a path, its end included, its start not."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], steps + 1)[1:]
    return np.stack([np.interp(at, length, path[:, i]) for i in range(path.shape[1])], axis=1)
