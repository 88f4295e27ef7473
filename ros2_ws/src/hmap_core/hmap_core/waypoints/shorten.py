"""Path shortening and smoothing, before the waypoints are determined."""

import numpy as np

from hmap_core.waypoints.checker import CLEARANCE_CAP, ObjectChecker
from hmap_core.waypoints.kernels import between, length, lengths
from hmap_core.waypoints.roadmap import NODE_COST

# number of random shortcuts
SHORTCUTS = 60
# smallest saving of a shortcut, m (rotation times radius counts as length)
MIN_SAVING = 1e-3
# step sizes by which corners are moved away from obstacles, m
RELAX_STEPS = (0.02, 0.01, 0.005)
# desired distance beyond the minimum distance, m
EXTRA_CLEARANCE = 0.01
# the last part of a motion to a shape, and the first one away from it, in which it may be near, m
LANDING = 0.03
# a contact persists while the distance changes by at most this, m
STILL_TOUCHED = 1e-3
# largest additional path length at a corner for the extra clearance, m
EXTRA_CLEARANCE_LENGTH = 0.01


def smooth(checker: ObjectChecker, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shorten and smooth a free path, until the deadline of the checker.

    Args:
        checker: decides what is free.
        path: (n, 7) poses.
        rng: the only source of randomness.

    Returns:
        A free path (m, 7) with the same ends: shorter, with fewer corners, and farther from obstacles.
    """
    path = drop_corners(checker, path)
    if len(path) > 2:
        path = drop_corners(checker, shortcut(checker, path, rng))
        path = relax(checker, turn_late(checker, path))
    return path


def drop_corners(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """The cheapest free subsequence of the corners (n, 7); every corner costs NODE_COST."""
    if checker.late:
        return path
    radius = checker.radius
    n = len(path)
    cost = np.full(n, np.inf)
    previous = np.zeros(n, int)
    cost[0] = 0.0
    near = _passed(checker, path)
    for j in range(1, n):
        for i in range(j):
            through = cost[i] + length(path[i], path[j], radius) + NODE_COST
            if through >= cost[j] - 1e-12:
                continue
            if i == j - 1 or _replaces(checker, path[i], path[j], near[2 * i + 1 : 2 * j]):
                cost[j], previous[j] = through, i
    order = [n - 1]
    while order[-1] > 0:
        order.append(int(previous[order[-1]]))
    return path[order[::-1]]


def shortcut(checker: ObjectChecker, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random shortcuts between points of the path (Geraerts & Overmars, IJRR 2007)."""
    radius = checker.radius
    near = _passed(checker, path)
    for _ in range(SHORTCUTS):
        if checker.late:
            break
        parts = lengths(path, radius)
        ends = np.concatenate(([0.0], parts.cumsum()))
        s, t = np.sort(rng.random(2)) * ends[-1]
        i, j = np.minimum(ends.searchsorted((s, t), side="right") - 1, len(parts) - 1)
        if i == j:
            continue
        a = between(path[i], path[i + 1], np.array([(s - ends[i]) / parts[i]]))[0]
        b = between(path[j], path[j + 1], np.array([(t - ends[j]) / parts[j]]))[0]
        if (t - s) - length(a, b, radius) > MIN_SAVING and _replaces(checker, a, b, near[2 * i + 2 : 2 * j + 1]):
            candidate = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
            # parts of checked motions are free only up to rounding, so they are checked again
            if checker.motion_free(path[i], a) and checker.motion_free(b, path[j + 1]):
                path = candidate
                near = _passed(checker, path)
    return path


def _passed(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """Which shapes are nearer than the minimum distance, (2 n - 1, SB): at the n corners, and between each two.

    Only shapes count that the body touches at the path's start or goal; it keeps the distance to the others.
    """
    if not checker.contact.any():
        return np.zeros((2 * len(path) - 1, len(checker.contact)), bool)
    middles = [between(a, b, np.array([0.5]))[0] for a, b in zip(path[:-1], path[1:], strict=True)]
    poses = np.empty((2 * len(path) - 1, 7))
    poses[::2], poses[1::2] = path, np.reshape(middles, (-1, 7))
    return checker.contact & (np.array([checker.distances(T) for T in poses]) < checker.min_distance)


def _replaces(checker: ObjectChecker, T0: np.ndarray, T1: np.ndarray, passed: np.ndarray) -> bool:
    """Whether the motion from T0 to T1 is free, with as much room as what it replaces.

    The minimum distance to a shape that the body touches at start or goal may be used up in a LANDING at an end that is
    near it, and where ``passed`` (k, SB) says that it is used up on the way there is.
    """
    if not checker.motion_free(T0, T1):
        return False
    near = ~checker.contact | passed.any(axis=0)
    if near.all():
        return True
    ends = [bool(((checker.distances(T) < checker.min_distance) & ~near).any()) for T in (T0, T1)]
    share = LANDING / max(length(T0, T1, checker.radius), 1e-12)
    if share * sum(ends) >= 1.0:
        return True
    first, last = between(T0, T1, np.array([share * ends[0], 1.0 - share * ends[1]]))
    return checker.motion_free(first, last, 0.0, near)


def _motions_free(checker: ObjectChecker, corners: np.ndarray, extra: float, near: list[np.ndarray | None]) -> bool:
    pairs = zip(corners[:-1], corners[1:], near, strict=True)
    return all(checker.motion_free(a, b, extra, own) for a, b, own in pairs)


def relax(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """Move each inner corner a little, if the motions next to it then keep EXTRA_CLEARANCE beyond the minimum distance.

    A shape that the body touches at the path's start or goal can be near while the body moves along it, but not if
    the body passes it elsewhere. If this is not possible, the corner keeps only the minimum distance to the shape, or
    else the distance of start or goal.
    """
    if checker.late:
        return path
    path = path.copy()
    near = _near(checker, path)
    for k in range(1, len(path) - 1):
        if checker.late:
            break
        own = near[k - 1 : k + 1]
        for extra, touched in ((EXTRA_CLEARANCE, own), (0.0, own), (EXTRA_CLEARANCE, [None, None])):
            better = _relaxed(checker, path[k - 1 : k + 2], extra, touched)
            if better is not None:
                path[k] = better
                break
    return path


def _near(checker: ObjectChecker, path: np.ndarray) -> list[np.ndarray]:
    """For each motion the shapes (SB,) that the body has touched since the start, or touches until the goal."""
    touching = np.maximum([checker.distances(T) for T in path], -CLEARANCE_CAP)  # finite after the deadline, too
    near = [np.zeros(touching.shape[1], bool) for _ in path[1:]]
    for own, order in (
        (checker.contact_at_end[0], range(len(near))),
        (checker.contact_at_end[1], range(len(near))[::-1]),
    ):
        at_end = touching[0 if order.step > 0 else -1]
        for leg in order:
            own = own & (np.abs(touching[leg if order.step > 0 else leg + 1] - at_end) <= STILL_TOUCHED)
            near[leg] |= own
    return near


def _relaxed(checker: ObjectChecker, corners: np.ndarray, extra: float, near: list) -> np.ndarray | None:
    """The best position near the middle one of three corners (3, 7) with the extra clearance, or None."""
    if _motions_free(checker, corners, extra, near):
        return corners[1]
    radius = checker.radius
    best, best_length = None, np.inf
    for step in RELAX_STEPS:
        for d in _directions(checker):
            moved = corners.copy()
            moved[1, :3] += step * d
            total = length(moved[0], moved[1], radius) + length(moved[1], moved[2], radius)
            if total < best_length and _motions_free(checker, moved, extra, near):
                best, best_length = moved[1], total
    before = length(corners[0], corners[1], radius) + length(corners[1], corners[2], radius)
    return best if best_length < before + EXTRA_CLEARANCE_LENGTH else None


def turn_late(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """Keep the orientation of the previous corner at each inner corner, if a small displacement makes that free.

    A body that turns for no reason is hard to push. The total rotation does not increase.
    """
    path = path.copy()
    steps = [np.zeros(3), *(step * d for step in sorted(RELAX_STEPS) for d in _directions(checker))]
    for k in range(1, len(path) - 1):
        if checker.late:
            break
        if np.array_equal(path[k, 3:], path[k - 1, 3:]):
            continue
        for step in steps:
            kept = np.concatenate([path[k, :3] + step, path[k - 1, 3:]])
            if checker.motion_free(path[k - 1], kept) and checker.motion_free(kept, path[k + 1]):
                path[k] = kept
                break
    return path


def _directions(checker: ObjectChecker) -> np.ndarray:
    """Unit vectors (n, 3) along which a corner can be moved."""
    if checker.planar:
        angle = np.arange(8) * np.pi / 4
        return np.c_[np.cos(angle), np.sin(angle), np.zeros(8)]
    return np.concatenate([np.eye(3), -np.eye(3)])
