"""Grasped objects that turn between the pads by their own weight, in physical mode.

Each pad presses on its patch with the gripper's force F and resists turning about the closing axis by friction. A patch
of any pressure distribution resists with at most mu F c, where c is the largest distance of its corners from its centre
(soft finger contact; Howe and Cutkosky, "Practical force-motion models for sliding manipulation", 1996). That bound is
generous: uniform pressure on a disc of radius c gives two thirds of it. Pads that touch a round side along a line are
not judged, since their softness decides.
"""

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.contacts import Contact
from hmap_core.validation.physics import friction_of, patches
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import center_of_mass

FLAT = 1e-3  # m; a patch that is narrower than this is a line
ALONE = 0.99  # share of the weight from which on one hand carries it alone


def check(contact: Contact, lifted: np.ndarray, share: np.ndarray, findings: Findings) -> None:
    """Reports a grasp in which the weight turns the object about the closing axis.

    Args:
        contact: the grasp.
        lifted: (n,) whether nothing but grippers carries the object, at each of the contact's samples.
        share: (n,) of the weight that this hand carries.
        findings: where violations go.
    """
    world, first = contact.world, contact.segment.first
    robot, body = world.arms[contact.robot].data, world.document.bodies[contact.object]
    alone = lifted & (np.abs(share) >= ALONE)
    pads = _pads(contact)
    if robot.gripper is None or not np.isfinite(robot.gripper.force) or len(pads) != 2 or not alone.any():
        return
    axis, centre = pads[0][1], np.mean([corners.mean(axis=0) for corners, _ in pads], axis=0)
    radii = [_radius(corners, axis) for corners, _ in pads]
    if min(radii) == 0.0:
        return
    R, _ = (values[contact.window] for values in world.state.bodies[contact.object])
    turned = R @ R[0].T  # (n, 3, 3) since the beginning
    lever, axes = turned @ (center_of_mass(world, contact.object, first) - centre), turned @ axis
    weight = body.mass * limits.GRAVITY * np.array([0.0, 0.0, -1.0])
    torque = np.abs(np.einsum("ni,ni->n", np.cross(lever, weight), axes)) * alone
    k = int(torque.argmax())
    held = friction_of(contact) * robot.gripper.force * sum(radii) * (1.0 + limits.GRIP_SLACK)
    findings.check(Kind.GRASP_TURNS, contact.bodies, world.document.time[first + k], torque[k], held)


def _pads(contact: Contact) -> list[tuple[np.ndarray, np.ndarray]]:
    """The corners (n, 3) of the patch of each of two opposed pads, and the normal (3,) into the object."""
    found = patches(contact)
    if not found:
        return []
    axis = found[0][1]
    sides = [[patch for patch in found if sign * (patch[1] @ axis) > 0.0] for sign in (1.0, -1.0)]
    return [(np.vstack([corners for corners, _ in side]), side[0][1]) for side in sides if side]


def _radius(corners: np.ndarray, axis: np.ndarray) -> float:
    """Largest distance (m) of corners (n, 3) from their mean, across an axis (3,); 0 if they are on a line."""
    away = corners - corners.mean(axis=0)
    away = away - np.outer(away @ axis, axis)
    if len(away) < 3 or np.linalg.svd(away, compute_uv=False)[1] < FLAT:
        return 0.0
    return float(np.linalg.norm(away, axis=1).max())
