"""Which contacts are tried first. Scores only order the tries; they decide nothing."""

import numpy as np

from hmap_core.contacts.candidates import Candidates, Situation
from hmap_core.transforms import apply, inverse, rotation_matrix

# weights of the terms, each in [0, 1]
W_CENTRAL = 1.0  # near the centre of mass
W_ABOVE = 0.6  # the hand comes from above
W_NEAR = 0.5  # on the side of the robot
W_MOTION = 0.5  # pushes the way the object goes
W_SEEN = 0.5  # seen by a camera
W_DEEP = 0.8  # the fingers reach well round the object
W_UPRIGHT = 2.0  # what is held is upright as it stood
W_STRAIGHT = 0.3  # the finger stands on the surface at a right angle
W_STEADY = 20.0  # pushes that have room before they slip or turn: more than all else together
# each further contact of the same sort (place, face, approach) counts this much less
W_REPEATED = 0.15
# size of a place, m
PLACE = 0.03


def central(points: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """1 at the centre, 0 at the object's ``radius`` from it."""
    return 1.0 - np.minimum(np.linalg.norm(points - centre, axis=1) / radius, 1.0)


def above(toward: np.ndarray, T_world_obj: np.ndarray) -> np.ndarray:
    """1 when the hand points straight down, 0 when it points up; ``toward`` (N, 3) is where it points."""
    return 0.5 - 0.5 * toward @ rotation_matrix(T_world_obj)[2]


def near(points: np.ndarray, situation: Situation, radius: float) -> np.ndarray:
    """1 on the side of the object towards the robot, 0 on the far side."""
    if situation.robot_position is None:
        return np.zeros(len(points))
    base = apply(inverse(situation.T_world_obj), situation.robot_position)
    toward = base / max(np.linalg.norm(base), radius)
    return 0.5 + 0.5 * np.clip(points @ toward / radius, -1.0, 1.0)


def along(normals: np.ndarray, situation: Situation) -> np.ndarray:
    """1 when pressing on the surface pushes the object where it goes next, 0 when the opposite way."""
    if situation.T_world_next is None:
        return np.zeros(len(normals))
    step = rotation_matrix(situation.T_world_obj).T @ (situation.T_world_next[:3] - situation.T_world_obj[:3])
    size = np.linalg.norm(step)
    return np.full(len(normals), 0.5) if size < 1e-9 else 0.5 - 0.5 * normals @ (step / size)


def place(points, normals, seen, centre, radius: float, situation: Situation) -> np.ndarray:
    """What counts (N,) for every contact with one side of the object, but for the hand: where it is, what it does.

    Points and normals (N, 3), and whether a camera sees them (N,).
    """
    return (
        W_CENTRAL * central(points, centre, radius)
        + W_NEAR * near(points, situation, radius)
        + W_MOTION * along(normals, situation)
        + W_SEEN * seen
    )


def ordered(sets: list[Candidates]) -> tuple[np.ndarray, np.ndarray]:
    """Set and index within it (N,) of all contacts: the best of each set in turn, those like earlier ones put back."""
    score = np.concatenate([s.score for s in sets])
    which = np.concatenate([np.full(len(s), k) for k, s in enumerate(sets)])
    index = np.concatenate([np.arange(len(s)) for s in sets])
    sort = np.concatenate([_sort(s) for s in sets]) * len(sets) + which
    by_sort = np.lexsort((-score, sort))
    groups = sort[by_sort]
    first = np.flatnonzero(np.concatenate(([True], groups[1:] != groups[:-1])))
    repeats = np.empty(len(score))
    repeats[by_sort] = np.arange(len(score)) - np.repeat(first, np.diff(np.append(first, len(score))))
    order = np.argsort(W_REPEATED * repeats - score, kind="stable")
    rank = np.empty(len(score))
    for k in range(len(sets)):
        own = order[which[order] == k]
        rank[own] = np.arange(len(own))
    order = np.lexsort((which, rank))
    return which[order], index[order]


def _sort(s: Candidates) -> np.ndarray:
    """One number (N,) for contacts at the same place, on the same face, with the hand from the same side."""
    place = np.round(s.point / PLACE).astype(np.int64)
    place -= place.min(axis=0)
    extent = place.max(axis=0) + 1
    cell = (place[:, 0] * extent[1] + place[:, 1]) * extent[2] + place[:, 2]
    return (cell * 6 + _side(s.normal)) * 6 + _side(s.toward)


def _side(vectors: np.ndarray) -> np.ndarray:
    """Which of the six axis directions each vector is nearest to, (N,)."""
    axis = np.abs(vectors).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(vectors, axis[:, None], axis=1)[:, 0] > 0.0)
