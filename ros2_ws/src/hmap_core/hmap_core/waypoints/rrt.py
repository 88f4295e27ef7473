"""RRTConnect on the object alone, with exact checks of whole motions; all of it compiled (``trees``)."""

import numpy as np

from hmap_core.waypoints import trees
from hmap_core.waypoints.checker import ObjectChecker
from hmap_core.waypoints.effort import Effort

# longest step of a tree as a fraction of the space's extent, and motions checked before the next is tried
ROUNDS = ((0.2, 200), (0.03, 4000))
# in the search a turn counts as this many times the way of the body's farthest point: passages are missed by angles
TURN_WEIGHT = 4.0
# motions checked between two looks at the clock, some 10 ms
SLICE = 1000


def rrt_path(
    checker: ObjectChecker,
    starts: list[np.ndarray],
    goals: list[np.ndarray],
    bounds: np.ndarray,
    rng: np.random.Generator,
    effort: Effort,
    scale: int = 1,
    rounds: tuple[tuple[float, int], ...] = ROUNDS,
) -> np.ndarray | None:
    """Poses (n, 7) of a free path from any of ``starts`` to any of ``goals``, or None when the rounds are used up.

    Args:
        checker: what is free; poses are those of its kind of motion.
        starts, goals: poses (7,), free, reachable from the true start and goal.
        bounds: (2, 3) lower and upper position, m.
        rng: the only source of randomness.
        effort: what may be done at most.
        scale: each round checks this many times its motions.
        rounds: of each the longest step as a fraction of the space's extent, and the motions checked.
    """
    for fraction, budget in rounds:
        path = _solve(checker, starts, goals, bounds, rng, fraction, budget * scale, effort)
        if path is not None:
            return path
    return None


def _solve(checker, starts, goals, bounds, rng, fraction, budget, effort) -> np.ndarray | None:
    roots = (np.array(starts, float), np.array(goals, float))
    count = np.array([len(roots[0]), len(roots[1]), 0])
    nodes = np.empty((2, count.max() + budget, 7))
    for side, poses in enumerate(roots):
        nodes[side, : len(poses)] = poses
    parent = np.full(nodes.shape[:2], -1)
    link = np.array([-1, -1])
    space = _space(checker, roots[0][0], np.asarray(bounds, float), fraction)
    used = 0
    while link[0] < 0 and used < budget and not effort.over:
        most = int(min(SLICE, budget - used, effort.checks))
        more = trees.grow(nodes, parent, count, link, rng, space, *checker.arrays, most)
        if more == 0:
            break
        used += more
        effort.spend(more)
        checker.checks += more
    if link[0] < 0:
        return None
    way, back = (_branch(nodes[side], parent[side], link[side]) for side in (0, 1))
    return np.concatenate([way[::-1], back])


def _space(checker: ObjectChecker, reference: np.ndarray, bounds: np.ndarray, fraction: float) -> tuple:
    """What ``trees.grow`` has to know of the space; steps are a ``fraction`` of its extent."""
    radius = TURN_WEIGHT * checker.radius
    diagonal = np.linalg.norm((bounds[1] - bounds[0])[: 2 if checker.planar else 3])
    return checker.planar, reference, bounds[0], bounds[1], radius, fraction * (float(diagonal) + np.pi * radius)


def _branch(nodes: np.ndarray, parent: np.ndarray, k: int) -> np.ndarray:
    """Poses (n, 7) from node ``k`` of a tree back to its root."""
    order = []
    while k >= 0:
        order.append(k)
        k = parent[k]
    return nodes[order]
