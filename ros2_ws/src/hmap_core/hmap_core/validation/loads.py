"""Weights of a plan in physical mode: what a gripper holds, and what an arm carries or pushes.

Two pads that press with the gripper's force F hold at most 2 mu F across the closing axis by Coulomb friction, and one
finger pushes back with at most F along it. A grasped object that has left its support needs its mass times the
difference of its acceleration and gravity; several hands share it by their lever arms. Acceleration is the second
difference of the centre of mass.
"""

import numpy as np

from hmap_core.validation import limits, shared, turning
from hmap_core.validation.contacts import Contact
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import SupportFinder, center_of_mass, lowest_points
from hmap_core.validation.world import World

UP = np.array([0.0, 0.0, 1.0])


def check(world: World, contacts: list[Contact], finder: SupportFinder, findings: Findings) -> None:
    """Reports grasps that do not hold the weight of their object, and weights beyond an arm's payload.

    Only in physical mode. Robots without a payload in the file carry any weight.
    """
    if world.document.mode != "physical":
        return
    grasps = shared.grasps_of(contacts)
    for contact in contacts:
        if contact.kind in ("push", "press"):
            _check_pushed(contact, findings)
    for contact in grasps:
        lifted = _lifted(contact, finder)
        if lifted.any():
            share = shared.shares(contact, grasps)
            _check_held(contact, lifted, share, findings)
            turning.check(contact, lifted, share, findings)
        elif np.ptp(world.poses[contact.object][contact.window, :3], axis=0).max() > limits.LIFTED:
            _check_pushed(contact, findings)  # it is dragged


def _check_pushed(contact: Contact, findings: Findings) -> None:
    """Checks that the friction of a pushed or dragged object with its support is within what the arm carries."""
    body, payload = contact.world.document.bodies[contact.object], contact.world.arms[contact.robot].data.payload
    findings.check(Kind.PAYLOAD, contact.bodies, contact.segment.start, body.friction * body.mass, payload)


def _lifted(contact: Contact, finder: SupportFinder) -> np.ndarray:
    """The samples (n,) of a grasp in which nothing but the gripper carries the object."""
    first, window = contact.segment.first, contact.window
    if contact.tool_grasp or not finder.at(contact.object, first).bodies:
        return np.ones(window.stop - window.start, bool)
    lowest = lowest_points(contact.world, contact.object, window)
    return np.abs(lowest - lowest[0]) > limits.LIFTED


def _check_held(contact: Contact, lifted: np.ndarray, share: np.ndarray, findings: Findings) -> None:
    world, window = contact.world, contact.window
    body, robot = world.document.bodies[contact.object], world.arms[contact.robot].data
    samples = contact.segment.first + np.flatnonzero(lifted)
    times = world.document.time[samples]
    mass = body.mass * np.abs(share)
    k = int(np.argmax(mass[lifted]))
    findings.check(Kind.PAYLOAD, contact.bodies, times[k], mass[lifted][k], robot.payload)
    if robot.gripper is None or not np.isfinite(robot.gripper.force):
        return
    force = mass[:, None] * (_acceleration(contact) + limits.GRAVITY * UP)
    R, _ = world.arms[contact.robot].end_effector(world.state.links[contact.robot])
    closing = R[window, :, 1]
    along = np.einsum("ni,ni->n", force, closing)
    across = np.linalg.norm(force - along[:, None] * closing, axis=1)
    press = robot.gripper.force
    friction = 2.0 * min(body.friction, robot.finger_friction) * press
    for needed, held in ((across[lifted], friction), (np.abs(along)[lifted], press)):
        k = int(needed.argmax())
        findings.check(Kind.GRIP_FORCE, contact.bodies, times[k], needed[k], held * (1.0 + limits.GRIP_SLACK))


def _acceleration(contact: Contact) -> np.ndarray:
    """Acceleration (n, 3) of the centre of mass of a grasp's object at its samples, m/s^2."""
    world, first = contact.world, contact.segment.first
    R, p = (values[contact.window] for values in world.state.bodies[contact.object])
    local = R[0].T @ (center_of_mass(world, contact.object, first) - p[0])
    place = p + R @ local
    acceleration = np.zeros_like(place)
    acceleration[1:-1] = np.diff(place, 2, axis=0) / world.document.dt**2
    return acceleration
