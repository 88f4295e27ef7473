"""Presses: fingers or a tool press on an object from above and drag it over its support, in physical mode.

The object slides if the pressing patch supplies the wrench of friction with the support. The support carries weight and
pressing force at their common centre of pressure. Its friction has an ellipsoidal limit surface (Howe and Cutkosky,
"Practical force-motion models for sliding manipulation", 1996) whose length is the mean distance of the footprint from
that centre. The pressing patch can concentrate its force at any of its corners. The friction coefficient of a pair is
the product of both bodies' coefficients.
"""

import numpy as np
import scipy

from hmap_core.validation import limits
from hmap_core.validation.contacts import Contact
from hmap_core.validation.physics import footprint_length, motions, patches
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import Support, SupportFinder, center_of_mass, inside, lowest_points, travelled
from hmap_core.validation.world import World

DIRECTIONS = 16  # of the friction of one corner of the patch
_ANGLES = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
UNKNOWN_FRICTION = 1.0  # of fingers, if the file does not say


def check(world: World, contacts: list[Contact], finder: SupportFinder, findings: Findings) -> None:
    """Reports presses from the side, without enough friction, or with which the object leaves its support."""
    if world.document.mode != "physical":
        return
    for contact in contacts:
        if contact.kind == "press" and not contact.tool_grasp:
            _check_direction(contact, findings)
            _check_payload(contact, findings)
            _check_height(contact, findings)
            _check_friction(contact, finder, findings)


def _check_direction(contact: Contact, findings: Findings) -> None:
    """Checks that the contact normals point downwards."""
    for _, normal in patches(contact):
        angle = np.degrees(np.arccos(np.clip(-normal[2], -1.0, 1.0)))
        limit = np.degrees(limits.PRESS_ANGLE)
        findings.check(Kind.PRESS_DIRECTION, contact.bodies, contact.segment.start, angle, limit)


def _check_payload(contact: Contact, findings: Findings) -> None:
    payload = contact.world.arms[contact.robot].data.payload
    mass = contact.segment.force / limits.GRAVITY
    findings.check(Kind.PAYLOAD, contact.bodies, contact.segment.start, mass, payload * (1.0 + limits.GRIP_SLACK))


def _check_height(contact: Contact, findings: Findings) -> None:
    """Checks that the object stays at the height of its support."""
    height = lowest_points(contact.world, contact.object, contact.window)
    off = np.abs(height - height[0])
    k = int(off.argmax())
    time = contact.world.document.time[contact.segment.first + k]
    findings.check(Kind.PRESS_LIFTED, contact.bodies, time, off[k], limits.LIFTED)


def _check_friction(contact: Contact, finder: SupportFinder, findings: Findings) -> None:
    world, first = contact.world, contact.segment.first
    found = patches(contact)
    points = np.vstack([corners for corners, _ in found]) if found else np.zeros((0, 3))
    if not len(points):
        return  # reported as a missing contact
    (R0, p0) = (values[first] for values in world.state.bodies[contact.object])
    local = (points - p0) @ R0
    length = footprint_length(contact, center_of_mass(world, contact.object, first)[:2])
    velocity, samples = motions(contact, length)
    marks = travelled(world, contact)
    for k in marks:
        time = world.document.time[k]
        support = finder.at(contact.object, k)
        pressure = _centre_of_pressure(contact, local, k)
        if support.region is None:
            findings.check(Kind.PRESS_LIFTED, contact.bodies, time, support.gap, limits.SUPPORT_GAP)
            continue
        findings.check(Kind.PRESS_LIFTED, contact.bodies, time, -inside(support.region, pressure), 0.0)
        near = np.flatnonzero(np.abs(samples - k) <= 1)
        for i in near[:1]:
            needed = _needed_force(contact, support, local, pressure, velocity[i] / [1.0, 1.0, length], k)
            allowed = contact.segment.force * (1.0 + limits.GRIP_SLACK)
            findings.check(Kind.PRESS_FRICTION, contact.bodies, time, needed, allowed)


def _centre_of_pressure(contact: Contact, local: np.ndarray, k: int) -> np.ndarray:
    """Where (2,) the support carries weight and pressing force at sample k, world frame."""
    world = contact.world
    R, p = (values[k] for values in world.state.bodies[contact.object])
    pressed = (local @ R.T + p).mean(axis=0)[:2]
    weight, force = world.document.bodies[contact.object].mass * limits.GRAVITY, contact.segment.force
    return (weight * center_of_mass(world, contact.object, k)[:2] + force * pressed) / (weight + force)


def _needed_force(
    contact: Contact, support: Support, local: np.ndarray, pressure: np.ndarray, twist: np.ndarray, k: int
) -> float:
    """Least force (N) with which the corners of the patch drag the object.

    Args:
        contact: the press.
        support: what carries the object.
        local: (n, 3) corners of the patch, object frame.
        pressure: (2,) centre of pressure at sample k, world frame.
        twist: (3,) velocity of the centre of mass and angular velocity, in the axes of the world at the start of the
            contact, rotated with the object since then.
        k: the sample.
    """
    world, first = contact.world, contact.segment.first
    body = world.document.bodies[contact.object]
    (Ra, _), (Rb, pb) = ((v[i] for v in world.state.bodies[contact.object]) for i in (first, k))
    turn = Rb @ Ra.T
    center = center_of_mass(world, contact.object, k)[:2]
    w = twist[2]
    v = turn[:2, :2] @ twist[:2] + w * np.array([-(pressure - center)[1], (pressure - center)[0]])
    length = footprint_length(contact, (pressure - center) @ turn[:2, :2] + _start_centre(contact))
    size = float(np.sqrt(v @ v + (length * w) ** 2))
    if size == 0.0:
        return 0.0
    carrying = [world.document.bodies[name].friction for name in support.bodies]
    load = body.mass * limits.GRAVITY + contact.segment.force
    total = body.friction * max(carrying, default=0.0) * load
    wrench = total * np.array([*v, length**2 * w]) / size
    arms = (local @ Rb.T + pb)[:, :2] - pressure
    directions = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
    moments = arms[:, :1] * directions[:, 1] - arms[:, 1:] * directions[:, 0]  # (n, D)
    columns = np.stack([*np.broadcast_to(directions.T[:, None], (2, *moments.shape)), moments]).reshape(3, -1)
    friction = body.friction * _pressing_friction(contact) / np.cos(np.pi / DIRECTIONS)
    found = scipy.optimize.linprog(np.ones(columns.shape[1]), A_eq=friction * columns, b_eq=wrench)
    return float(found.fun) if found.success else np.inf


def _start_centre(contact: Contact) -> np.ndarray:
    return center_of_mass(contact.world, contact.object, contact.segment.first)[:2]


def _pressing_friction(contact: Contact) -> float:
    """Coefficient of the fingers or of the tool."""
    if contact.by_tool:
        return contact.world.document.bodies[contact.segment.manipulator].friction
    own = contact.world.arms[contact.robot].data.finger_friction
    return own if np.isfinite(own) else UNKNOWN_FRICTION
