"""Shorter and smoother: what is done to a path before it is cut into waypoints."""

import numpy as np

from hmap_core.waypoints.checker import ObjectChecker
from hmap_core.waypoints.kernels import between, length, lengths
from hmap_core.waypoints.roadmap import NODE_COST

# random short cuts tried
SHORTCUTS = 60
# a short cut has to save this much, m (turn times radius counts as length)
MIN_SAVING = 1e-3
# corners are moved away from what they pass by this much at a time, m
RELAX_STEPS = (0.02, 0.01, 0.005)
# wanted beyond the minimum distance where there is room, m
COMFORT = 0.01
# a shape is still touched where its distance differs by no more than this, m
STILL_TOUCHED = 1e-3
# a corner may cost this much more length for its comfort, m
COMFORT_PRICE = 0.01


def smooth(checker: ObjectChecker, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A free path (m, 7) with the same ends as the free ``path`` (n, 7): fewer corners, shorter, off the walls."""
    path = drop_corners(checker, path)
    if len(path) > 2:
        path = drop_corners(checker, shortcut(checker, path, rng))
        path = relax(checker, turn_late(checker, path))
    return path


def drop_corners(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """The cheapest sub-sequence of the corners that is free; every corner costs NODE_COST."""
    radius = checker.radius
    n = len(path)
    cost = np.full(n, np.inf)
    previous = np.zeros(n, int)
    cost[0] = 0.0
    for j in range(1, n):
        for i in range(j):
            through = cost[i] + length(path[i], path[j], radius) + NODE_COST
            if through < cost[j] - 1e-12 and (i == j - 1 or checker.motion_free(path[i], path[j])):
                cost[j], previous[j] = through, i
    order = [n - 1]
    while order[-1] > 0:
        order.append(int(previous[order[-1]]))
    return path[order[::-1]]


def shortcut(checker: ObjectChecker, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random short cuts between points on the path (Geraerts & Overmars, IJRR 2007)."""
    radius = checker.radius
    for _ in range(SHORTCUTS):
        parts = lengths(path, radius)
        ends = np.concatenate(([0.0], parts.cumsum()))
        s, t = np.sort(rng.random(2)) * ends[-1]
        i, j = np.minimum(ends.searchsorted((s, t), side="right") - 1, len(parts) - 1)
        if i == j:
            continue
        a = between(path[i], path[i + 1], np.array([(s - ends[i]) / parts[i]]))[0]
        b = between(path[j], path[j + 1], np.array([(t - ends[j]) / parts[j]]))[0]
        if (t - s) - length(a, b, radius) > MIN_SAVING and checker.motion_free(a, b):
            candidate = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
            # parts of checked motions are free up to rounding; they are checked again rather than trusted
            if checker.motion_free(path[i], a) and checker.motion_free(b, path[j + 1]):
                path = candidate
    return path


def _comfortable(checker: ObjectChecker, corners: np.ndarray, extra: float, near: list[np.ndarray | None]) -> bool:
    pairs = zip(corners[:-1], corners[1:], near, strict=True)
    return all(checker.motion_free(a, b, extra, own) for a, b, own in pairs)


def relax(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """Move each inner corner a little so that the motions next to it keep COMFORT more than the min_distance, if
    they can.

    What is touched where the path begins or ends may be near as long as the body goes along it, but not when it passes
    it elsewhere; where that cannot be, the minimum distance alone is kept off it, else nothing.
    """
    path = path.copy()
    near = _near(checker, path)
    for k in range(1, len(path) - 1):
        own = near[k - 1 : k + 1]
        for extra, touched in ((COMFORT, own), (0.0, own), (COMFORT, [None, None])):
            better = _relaxed(checker, path[k - 1 : k + 2], extra, touched)
            if better is not None:
                path[k] = better
                break
    return path


def _near(checker: ObjectChecker, path: np.ndarray) -> list[np.ndarray]:
    """For each motion of a path, the shapes (SB,) touched at the start that were not left yet; or at the goal."""
    touching = np.array([checker.distances(T) for T in path])
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
    """Where the middle one of three corners (3, 7) is best for comfort; None: nowhere near."""
    if _comfortable(checker, corners, extra, near):
        return corners[1]
    radius = checker.radius
    best, best_length = None, np.inf
    for step in RELAX_STEPS:
        for d in _directions(checker):
            moved = corners.copy()
            moved[1, :3] += step * d
            total = length(moved[0], moved[1], radius) + length(moved[1], moved[2], radius)
            if total < best_length and _comfortable(checker, moved, extra, near):
                best, best_length = moved[1], total
    before = length(corners[0], corners[1], radius) + length(corners[1], corners[2], radius)
    return best if best_length < before + COMFORT_PRICE else None


def turn_late(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """Let each inner corner keep the orientation of the one before, moved a little where it has to be, if that is free.

    A body that is turned on the way for no reason is hard to push. All turn no more than before.
    """
    path = path.copy()
    steps = [np.zeros(3), *(step * d for step in sorted(RELAX_STEPS) for d in _directions(checker))]
    for k in range(1, len(path) - 1):
        if np.array_equal(path[k, 3:], path[k - 1, 3:]):
            continue
        for step in steps:
            kept = np.concatenate([path[k, :3] + step, path[k - 1, 3:]])
            if checker.motion_free(path[k - 1], kept) and checker.motion_free(kept, path[k + 1]):
                path[k] = kept
                break
    return path


def _directions(checker: ObjectChecker) -> np.ndarray:
    """Unit vectors (n, 3) in which a corner may be moved."""
    if checker.planar:
        angle = np.arange(8) * np.pi / 4
        return np.c_[np.cos(angle), np.sin(angle), np.zeros(8)]
    return np.concatenate([np.eye(3), -np.eye(3)])
