"""Whether a pushed object slides, or topples over its leading edge.

Friction with the support acts in the plane of the support, against the motion. The push and the pressure on the support
have to balance it, and the weight, without a moment that would lift the object off: the quasi-static condition of
Lynch, "Toppling manipulation" (1999). Forces at the corners of the contact patch lie in friction cones, so a contact
that sticks also holds the trailing side down.
"""

from collections.abc import Iterator

import numpy as np

from hmap_core.validation import limits, rigid
from hmap_core.validation.contacts import Contact
from hmap_core.validation.forces import balance
from hmap_core.validation.physics import friction_of, patches
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.support import SupportFinder, center_of_mass, travelled
from hmap_core.validation.world import World

CONE_EDGES = 8  # edges of the pyramid in a friction cone
BISECTIONS = 12  # to find the friction at which the object would slide
TINY = 1e-9
UP = np.array([0.0, 0.0, 1.0])


def check(world: World, contacts: list[Contact], finder: SupportFinder, findings: Findings) -> None:
    """Reports pushes whose object topples over or jams, and that friction allows; in physical mode only."""
    if world.document.mode != "physical":
        return
    for contact in contacts:
        if contact.kind == "push" and not findings.has(Kind.FRICTION_CONE, contact.bodies):
            _check_pushed(contact, finder, findings)


def _check_pushed(contact: Contact, finder: SupportFinder, findings: Findings) -> None:
    world = contact.world
    local = _local_patches(contact)
    for k in travelled(world, contact):
        support, direction = finder.at(contact.object, k), _direction(contact, k)
        if support.region is None or direction is None or not local:
            continue  # unsupported objects and missing contacts are other violations
        center = center_of_mass(world, contact.object, k)
        forces = np.concatenate(list(_forces(contact, local, center, k)))
        region = support.region - center[:2]
        needed = _friction(world, contact.object, support.bodies)
        if not _slides(forces, region, direction, needed):
            most = _largest_friction(forces, region, direction, needed)
            findings.add(Kind.PUSH_TOPPLES, contact.bodies, world.document.time[k], needed, most, needed - most)


def _local_patches(contact: Contact) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners (n, 3) and normal (3,) of the contact patches in the object's frame; they stick to it."""
    R, p = (values[contact.segment.first] for values in contact.world.state.bodies[contact.object])
    return [((points - p) @ R, normal @ R) for points, normal in patches(contact)]


def _direction(contact: Contact, k: int) -> np.ndarray | None:
    """Horizontal velocity (2,) of the centre of mass around sample k, as a share of the sliding speed.

    Its length is at most one: what the object turns takes its share of the friction. None where it hardly moves.
    """
    world, first, last = contact.world, contact.segment.first, contact.segment.last
    a, b = max(first, k - 1), min(last, k + 1)
    before, after = (center_of_mass(world, contact.object, i) for i in (a, b))
    duration = (b - a) * world.document.dt
    velocity = (after - before)[:2] / duration
    poses = world.poses[contact.object]
    turned = float(rigid.angle_between(poses[a : a + 1, 3:], poses[b : b + 1, 3:])[0])
    reach = float(np.mean([part.reach for part in world.parts_of(contact.object)])) / 2.0
    speed = float(np.hypot(np.linalg.norm(velocity), reach * turned / duration))
    return velocity / speed if speed > limits.PUSH_SPEED else None


def _forces(contact: Contact, local: list, center: np.ndarray, k: int) -> Iterator[np.ndarray]:
    """Edges of the friction cones at the contact patches: rows (m, 6) of position relative to the foot of the centre of
    mass, and force, world frame."""
    world = contact.world
    R, p = (values[k] for values in world.state.bodies[contact.object])
    lowest = min(
        float((world.tracks[part].R[k][2] @ part.solid.points.T).min() + world.tracks[part].p[k][2] - part.solid.ball)
        for part in world.parts_of(contact.object)
    )
    foot = np.array([*center[:2], lowest])
    friction = limits.REST_FRICTION * friction_of(contact)
    friction = friction if np.isfinite(friction) else 0.0
    for points, normal in local:
        normal = R @ normal
        first, second = np.linalg.svd(normal[None])[2][1:]
        angles = 2.0 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES
        edges = normal + friction * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
        places = points @ R.T + p - foot
        yield np.hstack([np.repeat(places, CONE_EDGES, axis=0), np.tile(edges, (len(places), 1))])


def _friction(world: World, name: str, carriers: frozenset[str]) -> float:
    """The friction coefficient of an object with what carries it: the lowest of all."""
    bodies = world.document.bodies
    return min(bodies[name].friction, *(bodies[carrier].friction for carrier in carriers))


def _slides(forces: np.ndarray, region: np.ndarray, direction: np.ndarray, friction: float) -> bool:
    """Whether forces (m, 6) of the push and pressure on corners (r, 2) of the support balance weight and friction.

    The weight is one, and acts at the origin. ``direction`` (2,) is a share of the direction of motion.
    """
    share = float(np.linalg.norm(direction))
    if share == 0.0:
        return True
    ahead = np.array([*direction, 0.0]) / share
    moments = np.cross(forces[:, :3], forces[:, 3:])[:, :2]
    pressed = np.cross(np.column_stack([region, np.zeros(len(region))]), UP)[:, :2]
    rows = np.vstack(
        [
            np.concatenate([forces[:, 5], np.ones(len(region))]),
            np.concatenate([forces[:, 3:] @ ahead, np.full(len(region), -friction * share)]),
            np.vstack([moments, pressed]).T,
        ]
    )
    rows[2:] /= max(float(np.abs(rows[2:]).max()), TINY)
    return balance(rows, np.array([1.0, 0.0, 0.0, 0.0]))


def _largest_friction(forces: np.ndarray, region: np.ndarray, direction: np.ndarray, above: float) -> float:
    """The largest friction coefficient below ``above`` at which the object slides."""
    low, high = 0.0, above
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _slides(forces, region, direction, middle) else (low, middle)
    return low
