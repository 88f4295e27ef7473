"""A small, deterministic roadmap that is searched before the trees grow, with lazy checks of its edges.

The nodes are the start, the goal, and poses that motions along an axis of the body or of the world reach from either:
out of a slot, up and over, around a corner, with the orientations of the start and of the goal; and quarter turns at
both ends. Edges are assumed to be free and are checked only if the shortest path uses them (Bohlin & Kavraki, "Path
planning using lazy PRM", ICRA 2000).
"""

import numpy as np
from numba import njit

from hmap_core.transforms import quaternion_multiply, rotation_matrix
from hmap_core.waypoints import kernels
from hmap_core.waypoints.checker import ObjectChecker

# motions checked before the trees start
MAX_CHECKS = 400
# heights of nodes above the higher of start and goal in spatial motion, m
LIFTS = (0.03, 0.08, 0.15, 0.3, 0.5)
# nodes are at these fractions of the free distance along an axis
FRACTIONS = (1.0, 0.5)
# a node is also in the middle of gaps that leave less room than this on both sides, m
GAP = 0.05
# distance from the end of the free motion, m
BACK_OFF = 0.01
# cost of each node as a length of path, m
NODE_COST = 0.05
# poses nearer than this are the same node, m (rotation times radius counts as length)
SAME_POSE = 1e-4
# cosine below which a direction is perpendicular to an axis
_ACROSS = 1e-9


def _directions(T: np.ndarray, planar: bool) -> np.ndarray:
    """Axes of the world and of the body at T, in both senses, (D, 3); only horizontal ones in planar motion."""
    axes = np.concatenate([np.eye(3), rotation_matrix(T).T])
    if planar:
        axes[:, 2] = 0.0
        axes = axes[np.linalg.norm(axes, axis=1) > 0.5]
        axes /= np.linalg.norm(axes, axis=1)[:, None]
    axes = np.concatenate([axes, -axes])
    keep = [k for k in range(len(axes)) if not np.any(axes[:k] @ axes[k] > 1.0 - 1e-6)]
    return axes[keep]


def _moved(T: np.ndarray, step: np.ndarray) -> np.ndarray:
    out = np.array(T, float)
    out[:3] += step
    return out


def _room(position: np.ndarray, axis: np.ndarray, bounds: np.ndarray) -> float:
    """Distance in m from a position (3,) along a unit axis to the boundary of a box (2, 3)."""
    to_edge = np.where(axis > 0.0, bounds[1] - position, bounds[0] - position)
    moving = np.abs(axis) > _ACROSS
    return max(float(np.min(to_edge[moving] / axis[moving])), 0.0)


def exits(checker: ObjectChecker, T: np.ndarray, other: np.ndarray, bounds: np.ndarray) -> list[np.ndarray]:
    """Poses that free motions along one axis reach from T.

    Args:
        checker: decides what is free.
        T: pose (7,), the start or the goal.
        other: pose (7,) of the other end; some exits are level with it.
        bounds: (2, 3) lower and upper position, m.

    Returns:
        The poses (7,), each with a supported motion from T.
    """
    found = []
    for axis in _directions(T, checker.planar):
        reach = _room(T[:3], axis, bounds)
        free = reach * checker.free_part(T, _moved(T, reach * axis))
        free -= BACK_OFF if free < reach else 0.0
        levels = [f * free for f in FRACTIONS] + [float((other[:3] - T[:3]) @ axis)]
        found += [_moved(T, d * axis) for d in levels if BACK_OFF < d <= free]
    return [e for e in found if checker.supported_along(T, e)]


def _in_the_middle(checker: ObjectChecker, T: np.ndarray) -> np.ndarray:
    """T (7,) moved along the world's axes to the middle of the gaps that it is in."""
    T = np.array(T, float)
    for axis in np.eye(3)[: 2 if checker.planar else 3]:
        ahead, back = (checker.free_part(T, _moved(T, side * GAP * axis)) for side in (1.0, -1.0))
        if ahead < 1.0 and back < 1.0:
            T = _moved(T, 0.5 * GAP * (ahead - back) * axis)
    return T


def _turned(checker: ObjectChecker, T: np.ndarray) -> list[np.ndarray]:
    """T (7,) rotated by quarter turns about the body's axes; about the vertical only if its tilt stays."""
    sine = np.sqrt(0.5)
    quarter = [np.array([*(side * sine * axis), sine]) for axis in np.eye(3) for side in (1.0, -1.0)]
    if checker.level:
        return [np.concatenate([T[:3], quaternion_multiply(q, T[3:])]) for q in quarter[4:]]
    return [np.concatenate([T[:3], quaternion_multiply(T[3:], q)]) for q in quarter]


def _nodes(
    checker: ObjectChecker, start: np.ndarray, goal: np.ndarray, radius: float, bounds: np.ndarray
) -> np.ndarray:
    poses = [start, goal, *exits(checker, start, goal, bounds), *exits(checker, goal, start, bounds)]
    if not checker.planar:
        top = max(start[2], goal[2])
        poses += [_moved(T, np.array([0.0, 0.0, top + h - T[2]])) for T in (start, goal) for h in LIFTS]
    middles = [_in_the_middle(checker, T) for T in (start, goal)]
    poses += middles + [turned for T in (start, goal, *middles) for turned in _turned(checker, T)]
    poses += [np.concatenate([T[:3], q]) for T in list(poses) for q in (start[3:], goal[3:])]
    nodes = np.array(poses)
    near = kernels.all_lengths(nodes, radius) <= SAME_POSE
    new = [k for k in range(len(nodes)) if k < 2 or not near[k, :k].any()]
    return nodes[[k for k in new if k < 2 or checker.pose_free(nodes[k])]]


@njit(cache=True)
def _shortest(cost, previous):
    """Dijkstra's algorithm from node 0 on a dense matrix (N, N); fills ``previous`` (N,)."""
    n = cost.shape[0]
    best = np.full(n, np.inf)
    done = np.zeros(n, np.bool_)
    previous[:] = -1
    best[0] = 0.0
    for _ in range(n):
        u = -1
        for k in range(n):
            if not done[k] and (u < 0 or best[k] < best[u]):
                u = k
        if u == 1 or not np.isfinite(best[u]):
            return
        done[u] = True
        for k in range(n):
            if best[u] + cost[u, k] < best[k]:
                best[k] = best[u] + cost[u, k]
                previous[k] = u


def direct_path(checker: ObjectChecker, start: np.ndarray, goal: np.ndarray, bounds: np.ndarray) -> np.ndarray | None:
    """Search a free path on the small roadmap.

    Args:
        checker: decides what is free.
        start: pose (7,).
        goal: pose (7,); the straight motion from the start is known to be blocked.
        bounds: (2, 3) lower and upper position, m.

    Returns:
        Poses (n, 7), or None.
    """
    nodes = _nodes(checker, start, goal, checker.radius, bounds)
    cost = kernels.all_lengths(nodes, checker.radius) + NODE_COST
    np.fill_diagonal(cost, np.inf)
    known = np.zeros(cost.shape, bool)
    cost[0, 1] = cost[1, 0] = np.inf
    previous = np.empty(len(nodes), np.int64)
    limit = checker.checks + MAX_CHECKS
    while checker.checks < limit and not checker.late:
        _shortest(cost, previous)
        if previous[1] < 0:
            return None
        order = [1]
        while order[-1] != 0:
            order.append(int(previous[order[-1]]))
        blocked = False
        for a, b in zip(order[1:], order[:-1], strict=True):
            if known[a, b]:
                continue
            known[a, b] = known[b, a] = True
            if not checker.motion_free(nodes[a], nodes[b]):
                cost[a, b] = cost[b, a] = np.inf
                blocked = True
                break
        if not blocked:
            return nodes[order[::-1]]
    return None
