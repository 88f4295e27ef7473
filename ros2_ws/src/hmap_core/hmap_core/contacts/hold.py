"""Whether a grasp keeps what it holds from turning in the hand: the friction of the pads against weight and pushing.

Each pad resists a turn about the closing axis like a disc of radius r under the gripper's force F, by (2/3) mu F r
(Coulomb friction under even pressure; as in Howe & Cutkosky, IJRR 1996); two pads do, with r the pads' half width.
"""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.access import on_face
from hmap_core.contacts.solids import solids
from hmap_core.komo.shapes import body_set
from hmap_core.transforms import IDENTITY, rotation_matrices, rotation_matrix
from hmap_core.types import AttachedBody, Body, ContactKind, ContactPoint, Gripper
from hmap_core.waypoints.support import centre_of_mass

GRAVITY = 9.81  # m/s^2
# steps in which the face under a pad is looked at, from its edge inwards
_STEPS = np.linspace(1.0, 0.0, 11)


def turning_share(body: Body, contacts: Sequence[ContactPoint], gripper: Gripper, up: np.ndarray) -> np.ndarray:
    """Share (K,) of the turning friction of each grasp that the body's weight uses up; above 1 it turns in the hand.

    ``up`` (3,) is the vertical in the body's frame. Contacts that are no grasps use nothing.
    """
    centre = centre_of_mass(body_set(body))
    capacity = 4.0 / 3.0 * body.friction * gripper.force * gripper.pad_half_width
    if not contacts:
        return np.zeros(0)
    origins, closing = _closing(contacts, gripper, [contact.opening for contact in contacts])
    moment = np.einsum("ki,ki->k", np.cross(centre - origins, -body.mass * GRAVITY * up), closing)
    grasps = np.array([contact.kind == ContactKind.GRASP for contact in contacts])
    return np.where(grasps, np.abs(moment) / capacity, 0.0)


def pushing_share(held: AttachedBody, gripper: Gripper, body: Body, contacts: Sequence[ContactPoint]) -> np.ndarray:
    """The same (K,) where pushes of a held body against an object that slides on its support try to turn it.

    The support resists with at most the object's friction coefficient times its weight, along the normal.
    """
    capacity = 4.0 / 3.0 * held.friction * gripper.force * gripper.pad_half_width
    force = body.friction * body.mass * GRAVITY
    if not contacts:
        return np.zeros(0)
    origins, closing = _closing(contacts, gripper, [held.opening] * len(contacts))
    points, normals = (np.array([getattr(c, name) for c in contacts]) for name in ("point", "normal"))
    moment = np.einsum("ki,ki->k", np.cross(points - origins, force * normals), closing)
    return np.abs(moment) / capacity


def _closing(
    contacts: Sequence[ContactPoint], gripper: Gripper, openings: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Where (K, 3) the pads are at openings (K,) in m, and their closing axes (K, 3), in the object's frame."""
    frames = np.array([c.T_obj_ee for c in contacts])
    R, origins = rotation_matrices(frames), frames[:, :3]
    if gripper.tips:
        origins = origins + R[:, :, 2] * np.array([gripper.reach_at(opening) for opening in openings])[:, None]
    return origins, R[:, :, 1]


def pad_balance(body: Body, contacts: Sequence[ContactPoint], gripper: Gripper) -> np.ndarray:
    """How evenly (K,) each grasp's pads lie on the object: 1 when as much of it is on either side of the pad's middle.

    Grasps as sampled, see :func:`hmap_core.contacts.hand.seated`: their frames are in the middle between the pads.
    0 when one side of the pad hangs over an edge. Contacts that are no grasps are even.
    """
    even = np.ones(len(contacts))
    own = [k for k, contact in enumerate(contacts) if contact.kind == ContactKind.GRASP]
    if not own:
        return even
    grasps = [contacts[k] for k in own]
    across = np.array([rotation_matrix(c.T_obj_ee)[:, 0] for c in grasps])
    normals = np.array([c.normal for c in grasps])
    middle = np.array([c.T_obj_ee[:3] for c in grasps])
    depth = np.einsum("ni,ni->n", np.array([c.point for c in grasps]) - middle, normals)
    points = middle + depth[:, None] * normals
    solid = solids([(shape, IDENTITY) for shape in body.shapes])
    sides = [
        on_face(points, normals, sign * gripper.pad_half_width * across, _STEPS, *solid.arrays) for sign in (-1.0, 1.0)
    ]
    wide = np.maximum(*sides)
    even[own] = np.where(wide > 0.0, np.minimum(*sides) / np.where(wide > 0.0, wide, 1.0), 0.0)
    return even
