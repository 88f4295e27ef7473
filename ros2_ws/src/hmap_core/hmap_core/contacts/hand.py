"""The hand of a robot as the contact sampler sees it, and where it has to be for its pads to touch."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.contacts.candidates import Hand
from hmap_core.kinematics.arm import LINK_TOLERANCE, Arm, LinkHull, load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import hull_set
from hmap_core.transforms import IDENTITY, apply, from_matrix, inverse, multiply, pose
from hmap_core.types import Body, ContactKind, ContactPoint, Gripper, Robot, ShapeKind

PALM_STEP = 0.001  # m to which the palm's distance is rounded down
FITS = 9e-4  # m that a closed finger may be off a surface or inside of it; the judge allows 1 mm
OPENINGS = 9  # at which the palm's distance is looked for where parts of the hand move with the opening


_PALMS: dict[int, tuple[Arm, float]] = {}


def hand_of(robot: Robot) -> Hand:
    """A robot's hand, or what it holds; an arm without fingers touches with its last link."""
    model = robot.model
    arm, gripper = load_arm(model), model.gripper
    if model.attached is not None or gripper is None:
        tip = arm.finger_vertices(0.0)
        return Hand(tip if len(tip) else arm.tip_vertices(), None, model.attached)
    closed = gripper.min_opening
    return Hand(arm.finger_vertices(closed), gripper, None, _palm(arm), closed)


def _palm(arm: Arm) -> float:
    """Distance (m) along the approach from what of the hand is nearest to an object between the pads, to their middle.

    The smallest over all openings; infinite where nothing of the hand can be in the way.
    """
    if id(arm) not in _PALMS:  # the arm is kept with it, so that no other one gets its id
        gripper = arm.model.gripper
        openings = np.linspace(gripper.min_opening, gripper.max_opening, OPENINGS)
        nearest = min(gripper.reach_at(opening) - _foremost(arm, opening) for opening in openings)
        _PALMS[id(arm)] = arm, PALM_STEP * np.floor(np.round(nearest / PALM_STEP, 3))
    return _PALMS[id(arm)][1]


def _foremost(arm: Arm, opening: float) -> float:
    """How far along the approach (m, end-effector frame) the hand reaches between its fingers, these left out."""
    T, half = inverse(from_matrix(arm.T_tip_ee)), 0.5 * opening
    farthest = -np.inf
    for hull in arm.hulls:
        if hull.frame == arm.n and not hull.finger:
            points, radius = apply(T, hull.at(opening)), max(hull.radius - LINK_TOLERANCE, 0.0)
            farthest = max(farthest, _highest_within(points, half + radius) + radius)
    return farthest


def _highest_within(points: np.ndarray, half: float) -> float:
    """Largest z of the convex hull of points (n, 3) where abs(y) is at most ``half`` (m); -inf where it is nowhere."""
    y, z = points[:, 1], points[:, 2]
    inside = np.abs(y) <= half
    highest = z[inside].max(initial=-np.inf)
    for edge in (-half, half):
        # the section at y = edge is the hull of where lines between points on either side cross it
        low, high = points[y < edge], points[y > edge]
        if len(low) and len(high):
            share = (edge - low[:, None, 1]) / (high[None, :, 1] - low[:, None, 1])
            highest = max(highest, float((low[:, None, 2] + share * (high[None, :, 2] - low[:, None, 2])).max()))
    return float(highest)


def seated(contacts: Sequence[ContactPoint], gripper: Gripper) -> list[ContactPoint]:
    """Grasps with the hand moved to where its pads are, which at other openings than closed lie elsewhere in it.

    Given are grasps with the end-effector frame in the middle of the object between the pads.
    """
    if not gripper.tips:
        return list(contacts)
    return [
        replace(c, T_obj_ee=multiply(c.T_obj_ee, pose((0.0, 0.0, -gripper.reach_at(c.opening)))))
        if c.kind == ContactKind.GRASP
        else c
        for c in contacts
    ]


def fitting(body: Body, contacts: Sequence[ContactPoint], robot: Robot) -> list[ContactPoint]:
    """The contacts without the grasps of which a closed finger hangs in the air, or is in another part of the object.

    The sampler looks along the closing axis, and sees neither what is beside the pads nor that faces lean. Grasps are
    those of :func:`seated`. A single box, cylinder, capsule or ball has nothing like that.
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
        return all(abs(distance) <= FITS for distance in off)

    return [contact for contact in contacts if contact.kind != ContactKind.GRASP or fits(contact)]


def _opened(finger: Sequence[LinkHull], opening: float) -> ConvexSet:
    """The hulls of a finger in the tip frame, the gripper open by ``opening`` metres."""
    return hull_set([(hull.at(opening), hull.radius, *hull.sphere_at(opening), hull.edges) for hull in finger])
