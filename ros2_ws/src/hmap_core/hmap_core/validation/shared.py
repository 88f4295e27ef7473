"""Objects that several robots grasp at the same time: whether the grasps are torn, and who carries how much.

Hands that grasp one rigid object cannot move against each other. Each hand carries the share of the weight that the
lever arms give: the shares add up to one, and their moments about the centre of mass are balanced as far as vertical
forces can balance them. With three hands or more, the shares that are most alike are taken.
"""

from itertools import combinations

import numpy as np

from hmap_core.validation import limits, rigid
from hmap_core.validation.contacts import Contact, worst
from hmap_core.validation.physics import patches
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import center_of_mass
from hmap_core.validation.world import State, World


def grasps_of(contacts: list[Contact]) -> list[Contact]:
    """The grasps by hands."""
    return [contact for contact in contacts if contact.kind == "grasp" and not contact.by_tool]


def check(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Reports pairs of hands that grasp one object and move against each other."""
    grasps = grasps_of(contacts)
    for a, b in combinations(grasps, 2):
        first = max(a.segment.first, b.segment.first)
        last = min(a.segment.last, b.segment.last)
        if a.object == b.object and a.robot != b.robot and first < last:
            _check_torn(world, a, b, first, last, findings)


def _check_torn(world: World, a: Contact, b: Contact, first: int, last: int, findings: Findings) -> None:
    """Compares the pose of one hand in the frame of the other with that at the beginning of the unbroken contacts."""
    steps = np.arange(first, last)
    R, p = _relative(a, b, world.state, slice(first, last + 1))
    R_half, p_half = _relative(a, b, world.between(steps, np.full(len(steps), 0.5)), slice(None))
    times = np.concatenate([world.document.time[first : last + 1], world.document.time[steps] + world.document.dt / 2])
    began = max(a.began, b.began)
    (R0,), (p0,) = _relative(a, b, world.state, slice(began, began + 1))
    off = rigid.deviation(np.concatenate([R, R_half]), np.concatenate([p, p_half]), R0, p0)
    k, amount, limit = worst(*off)
    findings.check(Kind.TORN_GRASP, (a.manipulator, b.manipulator, a.object), times[k], amount, limit)


def _relative(a: Contact, b: Contact, state: State, window: slice) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the end-effector of b in that of a: rotations (n, 3, 3) and positions (n, 3)."""
    (Ra, pa), (Rb, pb) = (c.world.arms[c.robot].end_effector(state.links[c.robot]) for c in (a, b))
    return rigid.relative(Ra[window], pa[window], Rb[window], pb[window])


def shares(contact: Contact, grasps: list[Contact]) -> np.ndarray:
    """The share (n,) of its object's weight that a grasp carries at its samples.

    Args:
        contact: the grasp.
        grasps: all grasps of the plan.
    """
    first, last = contact.segment.first, contact.segment.last
    others = [
        other
        for other in grasps
        if other.object == contact.object
        and other.robot != contact.robot
        and max(first, other.segment.first) <= min(last, other.segment.last)
    ]
    found = np.ones(last + 1 - first)
    if not others:
        return found
    world = contact.world
    R, p = (values[contact.window] for values in world.state.bodies[contact.object])
    local = R[0].T @ (center_of_mass(world, contact.object, first) - p[0])
    centre = (p + R @ local)[:, :2]
    points = np.stack([(p + R @ _place(own))[:, :2] for own in (contact, *others)], axis=1)
    grasping = np.stack([_holds(own, first, last) for own in (contact, *others)], axis=1)
    for pattern in np.unique(grasping, axis=0):
        at = (grasping == pattern).all(axis=1)
        found[at] = lever_shares(points[at][:, pattern], centre[at])[:, 0]
    return found


def _holds(grasp: Contact, first: int, last: int) -> np.ndarray:
    """Whether a grasp lasts at the samples from ``first`` to ``last``."""
    samples = np.arange(first, last + 1)
    return (samples >= grasp.segment.first) & (samples <= grasp.segment.last)


def _place(grasp: Contact) -> np.ndarray:
    """The middle (3,) of the fingers' contacts, in the object's frame; the end-effector if they do not touch."""
    world, k = grasp.world, grasp.segment.first
    found = [corners.mean(axis=0) for corners, _ in patches(grasp)]
    _, p_ee = world.arms[grasp.robot].end_effector(world.state.links[grasp.robot])
    point = np.mean(found, axis=0) if found else p_ee[k]
    R, p = world.state.bodies[grasp.object]
    return R[k].T @ (point - p[k])


def lever_shares(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Shares (n, h) of a weight at a centre of mass (n, 2) that h hands at points (n, h, 2) carry, seen from above."""
    hands = points.shape[1]
    arms = points - points.mean(axis=1, keepdims=True)
    squares, axes = np.linalg.eigh(np.einsum("nhi,nhj->nij", arms, arms))
    inverse = np.where(squares > limits.LEAST_LEVER**2, 1.0 / np.maximum(squares, limits.LEAST_LEVER**2), 0.0)
    way = np.einsum("nij,ni->nj", axes, centre - points.mean(axis=1)) * inverse
    return 1.0 / hands + np.einsum("nhi,nij,nj->nh", arms, axes, way)
