"""Shortcuts: fewer changes of contact, and straighter ways in each contact."""

from dataclasses import replace

import numpy as np

from hmap_core.baselines.birrt.search import Leg
from hmap_core.baselines.birrt.space import ObjectSpace

SHORTCUTS = 20  # tried for each leg
LEAST = 3  # poses between the ends of a shortcut


def shortened(legs: list[Leg], space: ObjectSpace, rng: np.random.Generator) -> list[Leg]:
    """The legs with as few changes of contact as one contact after the other allows, each with random shortcuts."""
    fewer: list[Leg] = []
    k = 0
    while k < len(legs):
        longest, k = _one_for_many(legs, k, space)
        fewer.append(_straighter(longest, space, rng))
    return fewer


def _one_for_many(legs: list[Leg], first: int, space: ObjectSpace) -> tuple[Leg, int]:
    """A leg that goes in its own contact as far as possible, and the number of the next one."""
    own = legs[first]
    for last in range(len(legs) - 1, first, -1):
        rest = np.concatenate([leg.poses[1:] for leg in legs[first + 1 : last + 1]])
        for poses, q, before in (
            (space.line(own.poses[0], rest[-1]), own.path[0], None),
            (np.concatenate([own.poses[-1:], rest]), own.path[-1], own),
        ):
            path, reached = own.mode.along(q, poses, False)
            if len(path) < len(poses):
                continue
            if before is not None:
                path, reached = np.concatenate([own.path, path[1:]]), np.concatenate([own.poses, reached[1:]])
            nodes = tuple(node for leg in legs[first : last + 1] for node in leg.nodes)
            return Leg(own.mode, path, reached, nodes), last + 1
    return own, first + 1


def _straighter(leg: Leg, space: ObjectSpace, rng: np.random.Generator) -> Leg:
    """A leg after random shortcuts of the object; the robot follows anew from each of them on."""
    for _ in range(SHORTCUTS):
        if len(leg.poses) <= LEAST:
            break
        i, j = sorted(rng.integers(0, len(leg.poses), 2))
        if j - i < LEAST:
            continue
        line = space.line(leg.poses[i], leg.poses[j])
        if len(line) > j - i:
            continue
        poses = np.concatenate([line, leg.poses[j + 1 :]])
        path, reached = leg.mode.along(leg.path[i], poses, False)
        if len(path) == len(poses):
            path, reached = np.concatenate([leg.path[:i], path]), np.concatenate([leg.poses[:i], reached])
            leg = replace(leg, path=path, poses=reached)
    return leg
