"""Scores that set the order in which contacts are tried. They do not decide whether a contact is feasible."""

import numpy as np

from hmap_core.contacts.candidates import Candidates, Situation
from hmap_core.transforms import apply, inverse, rotation_matrix

# weights of the terms, each in [0, 1]
W_CENTRAL = 1.0  # near the centre of mass
W_ABOVE = 0.6  # the hand comes from above
W_NEAR = 0.5  # on the side of the robot
W_MOTION = 0.5  # pushes in the direction of the object's motion
W_SEEN = 0.5  # visible to a camera
W_DEEP = 0.8  # the fingers reach far around the object
W_UPRIGHT = 2.0  # the attached body is as upright as it stood
W_STRAIGHT = 0.3  # the finger is perpendicular to the surface
W_ROBUST = 20.0  # pushes that are far from slipping and turning: more than all other terms together
# score difference of successive contacts of the same group (cell, face, approach)
W_REPEATED = 0.15
# edge of a cell, m
CELL = 0.03


def central(points: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """1 at the centre of mass, 0 at the object's ``radius`` (m) from it; points (N, 3)."""
    return 1.0 - np.minimum(np.linalg.norm(points - centre, axis=1) / radius, 1.0)


def above(toward: np.ndarray, T_world_obj: np.ndarray) -> np.ndarray:
    """1 if the hand points straight down, 0 if straight up; ``toward`` (N, 3) is its direction, object frame."""
    return 0.5 - 0.5 * toward @ rotation_matrix(T_world_obj)[2]


def near(points: np.ndarray, situation: Situation, radius: float) -> np.ndarray:
    """1 on the side of the object that faces the robot, 0 on the opposite side; points (N, 3), object frame."""
    if situation.robot_position is None:
        return np.zeros(len(points))
    base = apply(inverse(situation.T_world_obj), situation.robot_position)
    toward = base / max(np.linalg.norm(base), radius)
    return 0.5 + 0.5 * np.clip(points @ toward / radius, -1.0, 1.0)


def along(normals: np.ndarray, situation: Situation) -> np.ndarray:
    """1 if a force against the normals (N, 3) pushes the object along its motion, 0 if against it."""
    if situation.T_world_next is None:
        return np.zeros(len(normals))
    step = rotation_matrix(situation.T_world_obj).T @ (situation.T_world_next[:3] - situation.T_world_obj[:3])
    size = np.linalg.norm(step)
    return np.full(len(normals), 0.5) if size < 1e-9 else 0.5 - 0.5 * normals @ (step / size)


def position_score(points, normals, seen, centre, radius: float, situation: Situation) -> np.ndarray:
    """The score (N,) of contact positions, without the terms of the hand.

    Args:
        points: (N, 3) object frame, m.
        normals: (N, 3) outward unit normals.
        seen: (N,) whether a camera sees the point.
        centre: (3,) the object's centre of mass, m.
        radius: the object's radius about it, m.
        situation: the object's pose and motion, and the robot's position.
    """
    return (
        W_CENTRAL * central(points, centre, radius)
        + W_NEAR * near(points, situation, radius)
        + W_MOTION * along(normals, situation)
        + W_SEEN * seen
    )


def ordered(sets: list[Candidates]) -> tuple[np.ndarray, np.ndarray]:
    """The order of all contacts: the best of each set in turn, with contacts moved back that resemble earlier ones.

    Returns:
        Set, and index within it, of each contact, (N,) each.
    """
    score = np.concatenate([s.score for s in sets])
    which = np.concatenate([np.full(len(s), k) for k, s in enumerate(sets)])
    index = np.concatenate([np.arange(len(s)) for s in sets])
    group = np.concatenate([_group(s) for s in sets]) * len(sets) + which
    by_group = np.lexsort((-score, group))
    groups = group[by_group]
    first = np.flatnonzero(np.concatenate(([True], groups[1:] != groups[:-1])))
    repeats = np.empty(len(score))
    repeats[by_group] = np.arange(len(score)) - np.repeat(first, np.diff(np.append(first, len(score))))
    order = np.argsort(W_REPEATED * repeats - score, kind="stable")
    rank = np.empty(len(score))
    for k in range(len(sets)):
        own = order[which[order] == k]
        rank[own] = np.arange(len(own))
    order = np.lexsort((which, rank))
    return which[order], index[order]


def shuffled(sets: list[Candidates], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """All contacts in a random order: what is drawn first is a uniform sample. Returns as :func:`ordered`."""
    which = np.concatenate([np.full(len(s), k) for k, s in enumerate(sets)])
    index = np.concatenate([np.arange(len(s)) for s in sets])
    order = rng.permutation(len(which))
    return which[order], index[order]


def _group(s: Candidates) -> np.ndarray:
    """A number (N,) that contacts share with the same cell, face, and side of approach."""
    place = np.round(s.point / CELL).astype(np.int64)
    place -= place.min(axis=0)
    extent = place.max(axis=0) + 1
    cell = (place[:, 0] * extent[1] + place[:, 1]) * extent[2] + place[:, 2]
    return (cell * 6 + _side(s.normal)) * 6 + _side(s.toward)


def _side(vectors: np.ndarray) -> np.ndarray:
    """Index (N,) of the axis direction, out of six, that is nearest to each vector (N, 3)."""
    axis = np.abs(vectors).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(vectors, axis[:, None], axis=1)[:, 0] > 0.0)
