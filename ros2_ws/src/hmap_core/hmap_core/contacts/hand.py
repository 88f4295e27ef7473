"""The model of a robot's hand for the contact sampler, and the hand's pose at which its pads touch."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.contacts.candidates import SHALLOWEST, Hand
from hmap_core.kinematics.arm import LINK_TOLERANCE, Arm, LinkHull, load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import hull_set
from hmap_core.transforms import IDENTITY, apply, from_matrix, inverse, multiply, pose, rotation_matrices
from hmap_core.types import Body, ContactKind, ContactPoint, Gripper, Robot, ShapeKind

PALM_STEP = 0.001  # m; the palm's distance is rounded down to a multiple
FINGER_TOLERANCE = 9e-4  # m; largest distance and depth of a closed finger at a surface; the judge allows 1 mm
LEAST_BACK = 0.001  # m that a grasp is drawn back at least to count as another one
# number of openings at which the palm's distance is computed, for hands with parts that move with the opening
OPENINGS = 9


_PALMS: dict[int, tuple[Arm, float]] = {}


def hand_of(robot: Robot) -> Hand:
    """Make the hand model of a robot.

    With an attached body, that body touches in place of the fingers. An arm without fingers touches with its last link.
    """
    model = robot.model
    arm, gripper = load_arm(model), model.gripper
    if model.attached is not None or gripper is None:
        tip = arm.finger_vertices(0.0)
        fingers = len(tip) > 0
        return Hand(tip if fingers else arm.tip_vertices(), None, model.attached, tip_radius=arm.tip_radii(fingers))
    closed = gripper.min_opening
    return Hand(arm.finger_vertices(closed), gripper, None, _palm(arm), closed, arm.tip_radii(fingers=True))


def _palm(arm: Arm) -> float:
    """Distance (m) along the approach from the palm to the middle between the pads: the smallest over all openings.

    Infinite if no part of the hand can touch an object between the pads.
    """
    if id(arm) not in _PALMS:  # keeps the arm alive, so that no other arm gets its id
        gripper = arm.model.require_gripper()
        openings = np.linspace(gripper.min_opening, gripper.max_opening, OPENINGS)
        nearest = min(gripper.reach_at(opening) - _foremost(arm, opening) for opening in openings)
        _PALMS[id(arm)] = arm, PALM_STEP * np.floor(np.round(nearest / PALM_STEP, 3))
    return _PALMS[id(arm)][1]


def _foremost(arm: Arm, opening: float) -> float:
    """How far along the approach (m, end-effector frame) the hand without its fingers reaches between the fingers."""
    T, half = inverse(from_matrix(arm.T_tip_ee)), 0.5 * opening
    farthest = -np.inf
    for hull in arm.hulls:
        if hull.frame == arm.n and not hull.finger:
            points, radius = apply(T, hull.at(opening)), max(hull.radius - LINK_TOLERANCE, 0.0)
            farthest = max(farthest, _highest_within(points, half + radius) + radius)
    return farthest


def _highest_within(points: np.ndarray, half: float) -> float:
    """Largest z of the convex hull of points (n, 3) with abs(y) at most ``half`` (m); -inf without such points."""
    y, z = points[:, 1], points[:, 2]
    inside = np.abs(y) <= half
    highest = z[inside].max(initial=-np.inf)
    for edge in (-half, half):
        # the section at y = edge is the hull of its intersections with lines between points on both sides
        low, high = points[y < edge], points[y > edge]
        if len(low) and len(high):
            share = (edge - low[:, None, 1]) / (high[None, :, 1] - low[:, None, 1])
            highest = max(highest, float((low[:, None, 2] + share * (high[None, :, 2] - low[:, None, 2])).max()))
    return float(highest)


def align_pads(contacts: Sequence[ContactPoint], gripper: Gripper) -> list[ContactPoint]:
    """Move the hand of grasps to where its pads are at the object; the pads' position depends on the opening.

    Args:
        contacts: grasps have the end-effector frame in the middle between the pads; other kinds do not change.
        gripper: gives the pads' positions.

    Returns:
        The contacts, with corrected ``T_obj_ee`` of grasps.
    """
    if not gripper.tips:
        return list(contacts)
    return [
        replace(c, T_obj_ee=multiply(c.T_obj_ee, pose((0.0, 0.0, -gripper.reach_at(c.opening)))))
        if c.kind == ContactKind.GRASP
        else c
        for c in contacts
    ]


def drawn_back(contacts: Sequence[ContactPoint], gripper: Gripper) -> list[ContactPoint]:
    """The grasps among some contacts with as little of the pads on the object as the sampler allows.

    Args:
        contacts: grasps have the end-effector frame in the middle between the pads.
        gripper: gives the pads' length.

    Returns:
        New contacts, with the hand drawn back by LEAST_BACK or more; grasps that cannot be are left out.
    """
    grasps = [contact for contact in contacts if contact.kind == ContactKind.GRASP]
    if not grasps:
        return []
    frames = np.array([contact.T_obj_ee for contact in grasps])
    along = rotation_matrices(frames)[:, :, 2]  # the approach
    points = np.array([contact.point for contact in grasps])
    deep = np.einsum("ki,ki->k", points - frames[:, :3], along)  # how far the hands are drawn back already
    back = SHALLOWEST * gripper.tip_offset - deep
    frames[:, :3] -= back[:, None] * along
    return [replace(grasps[k], T_obj_ee=frames[k]) for k in np.flatnonzero(back >= LEAST_BACK)]


def drop_unfit_grasps(body: Body, contacts: Sequence[ContactPoint], robot: Robot) -> list[ContactPoint]:
    """Drop grasps in which a closed finger does not touch the object, or penetrates another part of it.

    The sampler considers the object along the closing axis only: neither the regions beside the pads nor sloping faces.
    Every grasp of a single box, cylinder, capsule or sphere fits.

    Args:
        body: the object.
        contacts: grasps come from :func:`align_pads`; other kinds are kept.
        robot: its fingers are checked.

    Returns:
        The contacts that fit.
    """
    if len(body.shapes) == 1 and body.shapes[0].kind is not ShapeKind.MESH:
        return list(contacts)
    arm, own = load_arm(robot.model), body_set(body)
    hulls = sorted((hull for hull in arm.hulls if hull.finger), key=lambda hull: hull.link)
    fingers = [list(group) for _, group in groupby(hulls, key=lambda hull: hull.link)]
    T_ee_tip = inverse(from_matrix(arm.T_tip_ee))

    def fits(contact: ContactPoint) -> bool:
        T = multiply(contact.T_obj_ee, T_ee_tip)
        off = (set_distance(_opened(finger, contact.opening), T, own, IDENTITY) for finger in fingers)
        return all(abs(distance) <= FINGER_TOLERANCE for distance in off)

    return [contact for contact in contacts if contact.kind != ContactKind.GRASP or fits(contact)]


def _opened(finger: Sequence[LinkHull], opening: float) -> ConvexSet:
    """The hulls of a finger in the tip frame, with the gripper open by ``opening`` metres."""
    return hull_set([(hull.at(opening), hull.radius, *hull.sphere_at(opening), hull.edges) for hull in finger])
