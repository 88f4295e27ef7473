"""RRT-Connect for one body, with exact checks of whole motions; ``trees`` is its compiled part.

Method: Kuffner & LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", ICRA 2000.
"""

from dataclasses import dataclass

import numpy as np

from hmap_core.waypoints import trees
from hmap_core.waypoints.checker import ObjectChecker
from hmap_core.waypoints.search_budget import SearchBudget

# longest step of a tree as a fraction of the space's extent, and number of motions checked with it
ROUNDS = ((0.2, 200), (0.03, 4000))
# factor of rotation in the metric, relative to the path of the body's farthest point: angle errors miss passages
TURN_WEIGHT = 4.0
# motions checked between two checks of the time limit, about 10 ms
SLICE = 1000


def rrt_path(
    checker: ObjectChecker,
    starts: list[np.ndarray],
    goals: list[np.ndarray],
    bounds: np.ndarray,
    rng: np.random.Generator,
    budget: SearchBudget,
    scale: int = 1,
    rounds: tuple[tuple[float, int], ...] = ROUNDS,
) -> np.ndarray | None:
    """Search a free path from any of ``starts`` to any of ``goals``.

    Args:
        checker: decides what is free; poses fit its motion type.
        starts: free poses (7,) that are reachable from the true start.
        goals: free poses (7,) from which the true goal is reachable.
        bounds: (2, 3) lower and upper position, m.
        rng: the only source of randomness.
        budget: limit of the search.
        scale: factor of the number of motions of each round.
        rounds: longest step as a fraction of the space's extent, and number of motions, for each round.

    Returns:
        Poses (n, 7), or None if the rounds or the budget end without a path.
    """
    for fraction, max_motions in rounds:
        path = grow_trees(checker, starts, goals, bounds, rng, fraction, max_motions * scale, budget).path()
        if path is not None:
            return path
    return None


@dataclass(frozen=True)
class GrownTrees:
    """Two trees, from the starts and from the goals.

    Attributes:
        nodes: (2, N, 7) poses, of which each tree has the first ``count``.
        parent: (2, N) index of each pose's parent, -1 for roots.
        count: (3,) number of poses in each tree, and of iterations.
        link: (2,) the nodes where the trees meet; -1 if they do not.
    """

    nodes: np.ndarray
    parent: np.ndarray
    count: np.ndarray
    link: np.ndarray

    def path(self) -> np.ndarray | None:
        """Poses (n, 7) from a start to a goal; None if the trees do not meet."""
        if self.link[0] < 0:
            return None
        way, back = (_branch(self.nodes[side], self.parent[side], self.link[side]) for side in (0, 1))
        return np.concatenate([way[::-1], back])


def grow_trees(
    checker: ObjectChecker,
    starts: list[np.ndarray],
    goals: list[np.ndarray],
    bounds: np.ndarray,
    rng: np.random.Generator,
    fraction: float,
    max_motions: int,
    budget: SearchBudget,
) -> GrownTrees:
    """Grow trees until they meet, or the budget ends.

    Args:
        checker, starts, goals, bounds, rng, budget: see :func:`rrt_path`.
        fraction: longest step as a fraction of the space's extent.
        max_motions: that may be checked.
    """
    roots = (np.array(starts, float), np.array(goals, float))
    count = np.array([len(roots[0]), len(roots[1]), 0])
    nodes = np.empty((2, count.max() + max_motions, 7))
    for side, poses in enumerate(roots):
        nodes[side, : len(poses)] = poses
    parent = np.full(nodes.shape[:2], -1)
    link = np.array([-1, -1])
    space = _space(checker, roots[0][0], np.asarray(bounds, float), fraction)
    used = 0
    while link[0] < 0 and used < max_motions and not budget.exhausted:
        most = int(min(SLICE, max_motions - used, budget.checks))
        *arrays, deadline = checker.arrays
        deadline = min(deadline, budget.clock_deadline)
        more = trees.grow(nodes, parent, count, link, rng, space, *arrays, deadline, most)
        if more == 0:
            break
        used += more
        budget.spend(more)
        checker.checks += more
    return GrownTrees(nodes, parent, count, link)


def _space(checker: ObjectChecker, reference: np.ndarray, bounds: np.ndarray, fraction: float) -> tuple:
    """The search space for ``trees.grow``; its longest step is a ``fraction`` of the space's extent."""
    radius = TURN_WEIGHT * checker.radius
    if checker.planar:
        bounds = bounds.copy()
        bounds[:, 2] = reference[2]
    diagonal = np.linalg.norm(bounds[1] - bounds[0])
    return checker.level, reference, bounds[0], bounds[1], radius, fraction * (float(diagonal) + np.pi * radius)


def _branch(nodes: np.ndarray, parent: np.ndarray, k: int) -> np.ndarray:
    """Poses (n, 7) from node ``k`` of a tree back to its root."""
    order = []
    while k >= 0:
        order.append(k)
        k = parent[k]
    return nodes[order]
