"""Which shapes of a scene matter in a box: scenes can have hundreds of bodies, and bodies hundreds of shapes."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from hmap_core.komo.shapes import body_set
from hmap_core.transforms import apply
from hmap_core.types import Body

ROUNDING = 1e-6  # m


def box_of(body: Body, T: np.ndarray) -> np.ndarray:
    """Lower and upper corner (2, 3) of a box round a body at T_world_body (7,), m."""
    shapes = body_set(body)
    center, bound = apply(T, shapes.center), shapes.bound[:, None]
    return np.array([(center - bound).min(axis=0), (center + bound).max(axis=0)])


def shapes_in_box(bodies: Iterable[tuple[Body, np.ndarray]], box: np.ndarray) -> list[tuple[Body, np.ndarray]]:
    """Bodies with those of their shapes that may reach into a box.

    Args:
        bodies: as (body, T_world_body).
        box: (2, 3) lower and upper corner, world frame, m.

    Returns:
        The bodies that have such shapes, with these alone.
    """
    kept = []
    for body, T in bodies:
        shapes = body_set(body)
        center = apply(T, shapes.center)
        apart = np.linalg.norm(np.maximum(np.maximum(box[0] - center, center - box[1]), 0.0), axis=1)
        near = np.flatnonzero(apart <= shapes.bound + ROUNDING)
        if len(near) == len(shapes):
            kept.append((body, T))
        elif len(near):
            kept.append((replace(body, shapes=tuple(body.shapes[k] for k in near)), T))
    return kept
