"""Whether a gripper can grasp an object at all, at any position."""

from collections.abc import Iterable

import numpy as np

from hmap_core.contacts.camera import visible_points
from hmap_core.contacts.candidates import Hand
from hmap_core.contacts.grasp import antipodal
from hmap_core.contacts.push import UPRIGHT
from hmap_core.contacts.solids import solids
from hmap_core.transforms import IDENTITY, rotation_matrix
from hmap_core.types import Body

SEED = 0  # of the surface points: the result is the same for the same body
SAMPLES = 200  # number of surface points


def grippable(body: Body, T_world_obj: np.ndarray, hands: Iterable[Hand]) -> bool:
    """Whether one of the hands can grasp upright sides of an object that stands at T_world_obj (7,)."""
    own = solids([(shape, IDENTITY) for shape in body.shapes])
    cloud = visible_points(body, T_world_obj, (), (), np.random.default_rng(SEED), SAMPLES, include_unseen=True)
    cloud = cloud[np.abs(cloud.normals @ rotation_matrix(T_world_obj)[2]) <= np.sin(UPRIGHT)]
    return any(hand.gripper is not None and bool(antipodal(cloud, own, hand, body.friction)[0].any()) for hand in hands)
