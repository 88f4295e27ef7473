"""Directions in which an object is pushed steadily: straight at one of its sides, past its centre of mass."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.contacts.camera import visible_points
from hmap_core.contacts.candidates import Hand
from hmap_core.contacts.grasp import antipodal
from hmap_core.contacts.push import UPRIGHT, Slide
from hmap_core.contacts.solids import solids
from hmap_core.transforms import IDENTITY, rotation_matrix
from hmap_core.types import Body

SEED = 0  # of the points of the surface: the same body gets the same answer
SAMPLES = 200  # points of the surface that are looked at for grasps
MIN_SIDE = 0.01  # m that a side has to go on, to either side of the line past the centre of mass
SAME_CORNER = 1e-4  # m
SAME_LINE = 1e-6  # m^2: corners whose triangle is smaller are on one line


def steady_directions(body: Body, T_world_obj: np.ndarray) -> np.ndarray:
    """Level unit directions (K, 2) of pushes straight at sides of an object that stands at T_world_obj (7,)."""
    slide = Slide(body, T_world_obj)
    if not slide.footprint:
        return np.zeros((0, 2))
    corners = np.concatenate(slide.footprint) - slide.middle
    corners = corners[np.unique(np.round(corners / SAME_CORNER), axis=0, return_index=True)[1]]
    hull = corners[ConvexHull(corners).vertices]  # counter-clockwise
    before, after = np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0)
    a, b = hull - before, after - hull
    hull = hull[np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > SAME_LINE]
    found = []
    for start, end in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        if MIN_SIDE <= -start @ along <= length - MIN_SIDE:
            found.append([-along[1], along[0]])
    return np.array(found).reshape(-1, 2)


def grippable(body: Body, T_world_obj: np.ndarray, hands: Iterable[Hand]) -> bool:
    """Whether one of the hands can close on upright sides of an object that stands at T_world_obj (7,)."""
    own = solids([(shape, IDENTITY) for shape in body.shapes])
    cloud = visible_points(body, T_world_obj, (), (), np.random.default_rng(SEED), SAMPLES, include_unseen=True)
    cloud = cloud[np.abs(cloud.normals @ rotation_matrix(T_world_obj)[2]) <= np.sin(UPRIGHT)]
    return any(hand.gripper is not None and bool(antipodal(cloud, own, hand, body.friction)[0].any()) for hand in hands)
