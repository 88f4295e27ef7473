"""Broad phase for many collision pairs, compiled: shapes in clusters with a ball round each, pairs in blocks.

Two clusters whose balls are far apart settle all pairs of their shapes at once. Clusters are the leaves of a bounding
volume hierarchy over the shapes of one frame (Ericson, "Real-Time Collision Detection", 2005, chapter 6). Where there
are few pairs, :mod:`hmap_core.komo.path_collisions` and :mod:`hmap_core.komo.sweep` look at each of them.
"""

from collections import deque, namedtuple

import numba as nb
import numpy as np

from hmap_core.clock import now
from hmap_core.collision.compile_options import OPTIONS, PLAIN
from hmap_core.collision.pairs import pair_distance, place_centers
from hmap_core.collision.scene_model import PER_PAIR, Collisions
from hmap_core.collision.simplex import WORK
from hmap_core.deadline import check_time, deadline
from hmap_core.kinematics.chain import Chain
from hmap_core.kinematics.tree import forward
from hmap_core.komo.collision_rows import LOOK_AHEAD
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.sweep import (
    PIECES,
    approach_bound,
    between_violations,
    derive,
    halve,
    new_motion,
    travel_bound,
)

MANY_PAIRS = 5_000  # above which blocks are made
CLUSTER = 8  # shapes of a cluster, at most

# Blocks: pairs first[i]:first[i+1] are those of block i (B + 1,). a, b (B,): numbers of its two clusters, which stand
# behind the shapes in a collision model; need (B,): largest minimum distance, m; phases (B,): bits of all pairs;
# order (P,): number of each pair in the model that the blocks were made of.
Blocks = namedtuple("Blocks", "first a b need phases order")

_LAST: deque[tuple[Collisions, Collisions, Blocks]] = deque(maxlen=1)  # a model, and what was made of it


def in_blocks(cols: Collisions) -> tuple[Collisions, Blocks]:
    """The pairs of a collision model in blocks, with the clusters as further shapes without vertices.

    What was made last is used again for a model that differs in its minimum distances only: the checks of one motion
    relax them one after the other.
    """
    last = _LAST[-1] if _LAST else None
    if last is None or not all(a is b for a, b in zip(_shapes_of(last[0]), _shapes_of(cols), strict=True)):
        last = (cols, *_clustered(cols))
        _LAST.append(last)
    _, more, blocks = last
    need = cols.min_distance[blocks.order]
    return more._replace(min_distance=need), blocks._replace(need=np.maximum.reduceat(need, blocks.first[:-1]))


def _shapes_of(cols: Collisions) -> Collisions:
    return cols._replace(min_distance=None)


def _clustered(cols: Collisions) -> tuple[Collisions, Blocks]:
    """As :func:`in_blocks`, but for the minimum distances, which are not sorted."""
    is_used = np.zeros(len(cols.frame), bool)
    is_used[cols.a] = is_used[cols.b] = True
    used = np.flatnonzero(is_used)
    cluster = np.full(len(cols.frame), -1)
    members: list[np.ndarray] = []
    for frame in np.unique(cols.frame[used]).tolist():
        for own in _clusters(cols.center, used[cols.frame[used] == frame]):
            cluster[own] = len(members)
            members.append(own)
    center = np.array([0.5 * (cols.center[own].min(axis=0) + cols.center[own].max(axis=0)) for own in members])
    away = [
        np.linalg.norm(cols.center[own] - middle, axis=1) + cols.bound[own]
        for own, middle in zip(members, center, strict=True)
    ]
    key = cluster[cols.a] * len(members) + cluster[cols.b]
    check_time()
    order = np.argsort(key, kind="stable")
    check_time()
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    count, none = len(cols.frame), np.zeros((len(members), 3))
    sorted_pairs = {name: getattr(cols, name)[order] for name in PER_PAIR if name != "min_distance"}
    blocks = Blocks(
        np.append(starts, len(order)).astype(np.int64),
        count + cluster[cols.a[order[starts]]],
        count + cluster[cols.b[order[starts]]],
        np.zeros(len(starts)),
        np.bitwise_or.reduceat(sorted_pairs["phases"], starts),
        order,
    )
    more = cols._replace(
        start=np.append(cols.start, np.full(len(members), cols.start[-1])),
        radius=np.append(cols.radius, np.zeros(len(members))),
        center=np.concatenate([cols.center, center.reshape(-1, 3)]),
        bound=np.append(cols.bound, [own.max() for own in away]),
        low=np.concatenate([cols.low, none]),
        high=np.concatenate([cols.high, none]),
        frame=np.append(cols.frame, [cols.frame[own[0]] for own in members]),
        speed=np.append(cols.speed, [cols.speed[own].max() for own in members]),
        edge=np.append(cols.edge, np.full(len(members), cols.edge[-1])),
        **sorted_pairs,
    )
    return more, blocks


def _clusters(center: np.ndarray, shapes: np.ndarray) -> list[np.ndarray]:
    """Groups of at most CLUSTER shapes, given by number, split at the median of where their centres differ most."""
    if len(shapes) <= CLUSTER:
        return [shapes]
    own = center[shapes]
    ranked = shapes[np.argsort(own[:, np.ptp(own, axis=0).argmax()], kind="stable")]
    half = len(ranked) // 2
    return _clusters(center, ranked[:half]) + _clusters(center, ranked[half:])


@nb.njit(**PLAIN)
def _apart(cols, blocks, i, centers):
    """How far the clusters of block i are apart, at least, less its largest minimum distance, m."""
    a, b = blocks.a[i], blocks.b[i]
    square = 0.0
    for x in range(3):
        square += (centers[a, x] - centers[b, x]) ** 2
    return np.sqrt(square) - cols.bound[a] - cols.bound[b] - blocks.need[i]


@nb.njit(**PLAIN)
def _move(cols, R, p, centers, turned, total):
    """Moves the shapes to new frames; adds to ``total`` (S,) how far any point of each has moved at most, m."""
    last, turn = -1, 0.0
    for s in range(cols.frame.shape[0]):
        f = cols.frame[s]
        if f == 0:
            continue
        if f != last:
            last, turn = f, 0.0
            for x in range(3):
                for y in range(3):
                    turn += (R[f, x, y] - turned[f, x, y]) ** 2
            turn = np.sqrt(0.5 * turn)
        square = 0.0
        for x in range(3):
            value = p[f, x]
            for y in range(3):
                value += R[f, x, y] * cols.center[s, y]
            square += (value - centers[s, x]) ** 2
            centers[s, x] = value
        total[s] += np.sqrt(square) + turn * cols.bound[s]
    for f in range(R.shape[0]):
        for x in range(3):
            for y in range(3):
                turned[f, x, y] = R[f, x, y]


@nb.njit(**OPTIONS)
def block_path_violations(path, masks, chain, cols, blocks, floor, deadline):
    """As :func:`hmap_core.komo.path_collisions.path_violations`, for pairs in blocks; ends early at a deadline."""
    M, n = path.shape
    P, S = cols.a.shape[0], cols.frame.shape[0]
    violation, pair = np.full(M, floor), np.full(M, -1, np.int64)
    R, p, turned = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3))
    centers, total, wake = np.zeros((S, 3)), np.zeros(S), np.full(P, -1.0)
    guesses, witness, work = np.zeros((P, 9), np.int16), np.zeros((3, 3)), np.zeros(WORK)
    for m in range(M):
        if deadline < np.inf and now() > deadline:
            break
        forward(path[m], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        if m == 0:
            place_centers(cols, R, p, centers)
        _move(cols, R, p, centers, turned, total)
        for i in range(blocks.a.shape[0]):
            if blocks.phases[i] & masks[m] == 0 or _apart(cols, blocks, i, centers) > -floor:
                continue
            for k in range(blocks.first[i], blocks.first[i + 1]):
                moved = total[cols.a[k]] + total[cols.b[k]]
                if wake[k] > moved or cols.phases[k] & masks[m] == 0:
                    continue
                need = cols.min_distance[k] - floor
                d = pair_distance(cols, k, R, p, centers, need + LOOK_AHEAD, guesses[k], witness, work)
                wake[k] = moved + d - need
                if cols.min_distance[k] - d > violation[m]:
                    violation[m], pair[m] = cols.min_distance[k] - d, blocks.order[k]
    return violation, pair


@nb.njit(**OPTIONS)
def block_between_violations(path, masks, chain, cols, blocks, resolution, deadline):
    """As :func:`hmap_core.komo.sweep.between_violations`, for pairs in blocks; ends early at a deadline."""
    T, n = path.shape[0] - 1, path.shape[1]
    P, S = cols.a.shape[0], cols.frame.shape[0]
    violation, pair, where = np.zeros(T), np.full(T, -1, np.int64), np.zeros(T)
    dq, q = np.zeros(n), np.zeros(n)
    R, p, turned = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3))
    R_own, p_own = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    centers, own, total, travel, wake = np.zeros((S, 3)), np.zeros((S, 3)), np.zeros(S), np.zeros(S), np.zeros(P)
    motion, motion_own, pieces = new_motion(n + 1), new_motion(n + 1), np.zeros((PIECES, 2))
    guesses, witness, work = np.zeros((P, 9), np.int16), np.zeros((3, 3)), np.zeros(WORK)
    half = 0.5
    for t in range(T):
        if deadline < np.inf and now() > deadline:
            break
        for i in range(n):
            dq[i] = path[t + 1, i] - path[t, i]
            q[i] = path[t, i] + half * dq[i]
        forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        derive(chain, dq, R, p, motion)
        if t == 0:
            place_centers(cols, R, p, centers)
        _move(cols, R, p, centers, turned, total)
        for s in range(S):
            travel[s] = travel_bound(cols, s, half, p, centers, motion)
        for i in range(blocks.a.shape[0]):
            if blocks.phases[i] & masks[t] == 0:
                continue
            if _apart(cols, blocks, i, centers) > travel[blocks.a[i]] + travel[blocks.b[i]]:
                continue
            for k in range(blocks.first[i], blocks.first[i + 1]):
                moved, moves = total[cols.a[k]] + total[cols.b[k]], travel[cols.a[k]] + travel[cols.b[k]]
                if wake[k] - moved > moves or cols.phases[k] & masks[t] == 0:
                    continue
                need = cols.min_distance[k]
                slack = pair_distance(cols, k, R, p, centers, need + moves, guesses[k], witness, work) - need
                wake[k] = slack + moved
                if -slack > violation[t]:
                    violation[t], pair[t], where[t] = -slack, blocks.order[k], half
                if slack > moves or not approach_bound(cols, k, half, p, centers, motion, witness) > max(
                    slack, resolution
                ):
                    continue
                worst, at = halve(
                    path, t, dq, k, chain, cols, resolution, q, R_own, p_own, own, motion_own, pieces, guesses[k],
                    witness, work,
                )  # fmt: skip
                if worst > violation[t]:
                    violation[t], pair[t], where[t] = worst, blocks.order[k], at
    return violation, pair, where


@nb.njit(**OPTIONS)
def _near(path, chain, cols, blocks, reach):
    """:meth:`PairChecks.near`, by number in the model that the blocks were made of."""
    n, S = path.shape[1], cols.frame.shape[0]
    near = np.zeros(cols.a.shape[0], np.bool_)
    R, p, centers = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((S, 3))
    for m in range(path.shape[0]):
        forward(path[m], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        place_centers(cols, R, p, centers)
        for i in range(blocks.a.shape[0]):
            if _apart(cols, blocks, i, centers) > reach:
                continue
            for k in range(blocks.first[i], blocks.first[i + 1]):
                a, b = cols.a[k], cols.b[k]
                square = 0.0
                for x in range(3):
                    square += (centers[a, x] - centers[b, x]) ** 2
                if np.sqrt(square) - cols.bound[a] - cols.bound[b] - cols.min_distance[k] <= reach:
                    near[blocks.order[k]] = True
    return near


class PairChecks:
    """Checks of paths of a chain against a collision model, in blocks where it has many pairs.

    Args:
        chain: what moves.
        cols: the pairs.

    Raises:
        PlannerError: TIME_LIMIT, of all methods, where there are many pairs.
    """

    def __init__(self, chain: Chain, cols: Collisions):
        self._chain, self._cols = chain, cols
        self._blocks: Blocks | None = None
        if len(cols.a) > MANY_PAIRS:
            self._cols, self._blocks = in_blocks(cols)

    def along(self, path: np.ndarray, masks: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
        """As :func:`hmap_core.komo.path_collisions.path_violations`."""
        if self._blocks is None:
            return path_violations(path, masks, self._chain, self._cols, floor)
        found = block_path_violations(path, masks, self._chain, self._cols, self._blocks, floor, deadline())
        check_time()
        return found

    def between(
        self, path: np.ndarray, masks: np.ndarray, resolution: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As :func:`hmap_core.komo.sweep.between_violations`."""
        if self._blocks is None:
            return between_violations(path, masks, self._chain, self._cols, resolution)
        found = block_between_violations(path, masks, self._chain, self._cols, self._blocks, resolution, deadline())
        check_time()
        return found

    def near(self, path: np.ndarray, reach: float) -> np.ndarray:
        """Which pairs (P,) may come nearer than their minimum distance and ``reach`` (m) at configurations (M, n).

        All of them where there are few.
        """
        if self._blocks is None:
            return np.ones(len(self._cols.a), bool)
        return _near(np.ascontiguousarray(path), self._chain, self._cols, self._blocks, reach)
