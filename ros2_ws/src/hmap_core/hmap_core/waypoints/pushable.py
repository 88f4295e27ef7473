"""A path of straight slides in a few directions: what can be pushed only, and steadily in these directions alone.

Between places of a path that was found free, the body goes straight in one of the directions or by two of them that lie
on either side of the way. The cheapest sequence is found by dynamic programming over places and directions.
"""

import numpy as np

from hmap_core.transforms import distance
from hmap_core.waypoints.checker import Geometry, ObjectChecker
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import resample

PLACE_STEP = 0.04  # m between places of the path at which the direction may change
ALIGNED = float(np.deg2rad(1.5))  # a way this near to a direction is in it
PUSH_COST = 0.2  # m of way that one push more is worth
SHORT, SHORT_COST = 0.03, 0.3  # m: a slide shorter than that costs as much as so many metres more
LEVEL = 1e-6  # m or rad that a path may rise or turn


def pushable(problem: ObjectPathProblem, poses: np.ndarray, directions: np.ndarray, margin: float) -> np.ndarray | None:
    """Poses (K, 7) from the first to the last of a free path (M, 7), by slides in level unit ``directions`` (D, 2).

    None where the path rises or turns, or there is no such way that is ``margin`` metres off all obstacles.
    """
    turn = max(distance(poses[0], T)[1] for T in poses[1:])
    if len(directions) == 0 or np.ptp(poses[:, 2]) > LEVEL or turn > LEVEL:
        return None
    checker = ObjectChecker(problem, Geometry(problem), True, margin)
    if checker.support is None:
        return None
    places = poses[_places(poses)]
    corners = _cheapest(checker, places, directions)
    return None if corners is None else resample(np.array(corners))[0]


def _places(poses: np.ndarray) -> np.ndarray:
    """Indices of poses (M, 7) about PLACE_STEP apart, first and last included."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1))])
    count = max(2, int(np.ceil(way[-1] / PLACE_STEP)) + 1)
    return np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], count)).clip(0, len(poses) - 1))


def _cheapest(checker: ObjectChecker, places: np.ndarray, directions: np.ndarray) -> list[np.ndarray] | None:
    """Corners of the cheapest way from the first place to the last, places (P, 7)."""
    best: list[dict[int, tuple[float, list[np.ndarray]]]] = [{} for _ in places]  # last direction -> cost, corners
    best[0][-1] = (0.0, [places[0]])
    for i, start in enumerate(places[:-1]):
        for j in range(i + 1, len(places)) if best[i] else ():
            for way in _ways(start, places[j], directions):
                corners = [corner for _, corner in way]
                if not all(checker.motion_free(a, b) for a, b in zip([start, *corners], corners, strict=False)):
                    continue
                for last, (cost, before) in best[i].items():
                    total = cost + _cost(start, way, last)
                    if total < best[j].get(way[-1][0], (np.inf,))[0]:
                        best[j][way[-1][0]] = total, [*before, *corners]
    return min(best[-1].values(), key=lambda entry: entry[0])[1] if best[-1] else None


def _cost(start: np.ndarray, way: list[tuple[int, np.ndarray]], last: int) -> float:
    total, at = 0.0, start
    for direction, corner in way:
        length = float(np.linalg.norm(corner[:2] - at[:2]))
        total += length
        if direction != last:
            total += PUSH_COST + (SHORT_COST if length < SHORT else 0.0)
        last, at = direction, corner
    return total


def _ways(start: np.ndarray, end: np.ndarray, directions: np.ndarray) -> list[list[tuple[int, np.ndarray]]]:
    """Ways from one pose to another: each a list of (number of the direction, pose at which that slide ends)."""
    step = end[:2] - start[:2]
    length = np.linalg.norm(step)
    across = directions[:, 0] * step[1] - directions[:, 1] * step[0]
    off = np.arctan2(across, directions @ step)  # of the way, to the left of each direction
    nearest = int(np.abs(off).argmin())
    if length == 0.0 or abs(off[nearest]) <= ALIGNED:
        return [[(nearest, end)]]
    left, right = np.where(off < 0.0, off, -np.inf), np.where(off > 0.0, off, np.inf)
    a, b = int(left.argmax()), int(right.argmin())
    if not np.isfinite(left[a]) or not np.isfinite(right[b]) or right[b] - left[a] >= np.pi - ALIGNED:
        return []
    shares = np.linalg.solve(directions[[a, b]].T, step)
    found = []
    for first, share, second in ((a, shares[0], b), (b, shares[1], a)):
        corner = start.copy()
        corner[:2] += share * directions[first]
        found.append([(first, corner), (second, end)])
    return found
