"""Torque limits of grasps: the pads' friction against the torques of weight and pushing about the closing axis.

Each pad is modelled as a disc of radius r (half the pad's width) under the gripper's force F. It resists rotation
about the closing axis with (2/3) mu F r (soft finger contact: Coulomb friction under uniform pressure; Howe &
Cutkosky, IJRR 1996). Two pads resist with twice that.
"""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.access import on_face
from hmap_core.contacts.solids import solids
from hmap_core.komo.shapes import body_set
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, rotation_matrices, rotation_matrix
from hmap_core.types import AttachedBody, Body, ContactKind, ContactPoint, Gripper

GRAVITY = 9.81  # m/s^2
# shares of a pad's half width at which the face below it is checked, from the edge inwards
_STEPS = np.linspace(1.0, 0.0, 11)


def weight_torque_ratio(body: Body, contacts: Sequence[ContactPoint], gripper: Gripper, up: np.ndarray) -> np.ndarray:
    """Ratio of the weight's torque about the closing axis to the torque that the pads' friction resists.

    Args:
        body: the grasped body.
        contacts: K contacts on it.
        gripper: the gripper.
        up: (3,) vertical direction in the body's frame.

    Returns:
        (K,) ratio; above 1 the body rotates in the gripper. 0 for contacts that are no grasps.
    """
    centre = centre_of_mass(body_set(body))
    capacity = 4.0 / 3.0 * body.friction * gripper.force * gripper.pad_half_width
    if not contacts:
        return np.zeros(0)
    origins, closing = _closing(contacts, gripper, [contact.opening for contact in contacts])
    moment = np.einsum("ki,ki->k", np.cross(centre - origins, -body.mass * GRAVITY * up), closing)
    grasps = np.array([contact.kind == ContactKind.GRASP for contact in contacts])
    return np.where(grasps, np.abs(moment) / capacity, 0.0)


def push_torque_ratio(held: AttachedBody, gripper: Gripper, body: Body, contacts: Sequence[ContactPoint]) -> np.ndarray:
    """Ratio of the pushing force's torque about the closing axis to the torque that the pads' friction resists.

    An attached body pushes an object that slides on its support. The support resists with at most the object's friction
    coefficient times its weight, along the contact normal.

    Args:
        held: the attached body.
        gripper: the gripper that grasps it.
        body: the pushed object.
        contacts: K contacts of the attached body on the object.

    Returns:
        (K,) ratio; above 1 the attached body rotates in the gripper.
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
    """Positions (K, 3) of the pads at openings (K,) in m, and closing axes (K, 3), in the object's frame."""
    frames = np.array([c.T_obj_ee for c in contacts])
    R, origins = rotation_matrices(frames), frames[:, :3]
    if gripper.tips:
        origins = origins + R[:, :, 2] * np.array([gripper.reach_at(opening) for opening in openings])[:, None]
    return origins, R[:, :, 1]


def pad_balance(body: Body, contacts: Sequence[ContactPoint], gripper: Gripper) -> np.ndarray:
    """How evenly each grasp's pads cover the object on both sides of the pads' middle.

    Where the object ends below that, as a low one between the fingertips does, the point of the contact counts.

    Args:
        body: the object.
        contacts: K contacts as sampled, before :func:`hmap_core.contacts.hand.align_pads`: the frames of grasps are in
            the middle between the pads.
        gripper: gives the pads' width.

    Returns:
        (K,) ratio of the smaller to the larger covered width: 1 with the same width on both sides, 0 if one side of the
        pad is beyond an edge. 1 for contacts that are no grasps.
    """
    even = np.ones(len(contacts))
    own = [k for k, contact in enumerate(contacts) if contact.kind == ContactKind.GRASP]
    if not own:
        return even
    grasps = [contacts[k] for k in own]
    across = np.array([rotation_matrix(c.T_obj_ee)[:, 0] for c in grasps])
    normals = np.array([c.normal for c in grasps])
    middle = np.array([c.T_obj_ee[:3] for c in grasps])
    touched = np.array([c.point for c in grasps])
    depth = np.einsum("ni,ni->n", touched - middle, normals)
    widths = _covered(body, middle + depth[:, None] * normals, normals, gripper.pad_half_width * across)
    beyond = widths.max(axis=0) == 0.0
    widths[:, beyond] = _covered(body, touched, normals, gripper.pad_half_width * across)[:, beyond]
    wide = widths.max(axis=0)
    even[own] = np.where(wide > 0.0, widths.min(axis=0) / np.where(wide > 0.0, wide, 1.0), 0.0)
    return even


def _covered(body: Body, points: np.ndarray, normals: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Shares (2, N) of the way from points to points - sides, and to points + sides, with material behind."""
    solid = solids([(shape, IDENTITY) for shape in body.shapes])
    return np.array([on_face(points, normals, sign * sides, _STEPS, *solid.arrays) for sign in (-1.0, 1.0)])
