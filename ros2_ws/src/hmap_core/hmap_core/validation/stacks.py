"""Whether stacks stay that the plan has changed: each body may stand well on another one that then tips.

The bodies of a stack are in equilibrium if forces inside the friction cones between them, and between them and what is
fixed, balance their weights. Their centres of mass may all be off by ``limits.STABLE_MARGIN`` in any level direction.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.contacts import Contact
from hmap_core.validation.forces import balance
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.rest import cone, friction_of, touch
from hmap_core.validation.support import SupportCheck, SupportFinder, center_of_mass, moved
from hmap_core.validation.world import World

OFFSETS = limits.STABLE_MARGIN * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
TINY = 1e-9


def check(world: World, contacts: Sequence[Contact], support: SupportCheck, findings: Findings) -> None:
    """Reports stacks of at least two movable bodies that tip; only in physical mode, and at rest.

    What stands as at the start is not judged if forces do not balance there either: measured bodies may be a little off
    each other.

    Args:
        world: the plan.
        contacts: all contacts.
        support: the check of the single bodies, after it has run.
        findings: where they are reported.
    """
    bodies = world.document.bodies
    names = {name for pair in support.pairs if not any(bodies[n].fixed for n in pair) for name in pair}
    if world.document.mode != "physical" or not names:
        return
    finder = support.finder
    first = _stacks(names, contacts, finder, 0)
    alone = sorted(names - {name for stack in first for name in stack})
    unclear = {name for stack in (*first, *([n] for n in alone)) if not _stays(world, stack, 0) for name in stack}
    seen = {_key(world, stack, 0) for stack in first}
    ends = sorted({k for segment in world.document.segments for k in (segment.first, segment.last)})
    for k in [*ends, world.samples - 1]:
        for stack in _stacks(names, contacts, finder, k):
            key = _key(world, stack, k)
            known = all(name not in unclear or moved(world, name, k) for name in stack)
            if key not in seen and known and not _stays(world, stack, k):
                time = float(world.document.time[k])
                least = limits.STABLE_MARGIN
                findings.add(Kind.UNSUPPORTED, tuple(sorted(stack)), time, 0.0, least, least)
            seen.add(key)


def _key(world: World, stack: Sequence[str], k: int) -> tuple:
    return tuple((name, world.poses[name][k].tobytes()) for name in sorted(stack))


def _stacks(names: set[str], contacts: Sequence[Contact], finder: SupportFinder, k: int) -> list[list[str]]:
    """The groups of some movable bodies that carry each other at sample k, without those that a robot touches then."""
    touched = {contact.object for contact in contacts if contact.segment.first < k < contact.segment.last}
    loose = sorted(names - touched)
    below = {name: [other for other in finder.at(name, k).bodies if other in loose] for name in loose}
    groups = {name: {name} for name in loose}
    for name, other in ((name, other) for name, others in below.items() for other in others):
        joined = groups[name] | groups[other]
        groups |= {member: joined for member in joined}
    stacks = {frozenset(group) for group in groups.values() if len(group) > 1}
    return sorted(sorted(stack) for stack in stacks)


def _stays(world: World, stack: Sequence[str], k: int) -> bool:
    """Whether the bodies of a stack are in equilibrium at sample k."""
    masses = np.array([world.document.bodies[name].mass for name in stack])
    centers = np.array([center_of_mass(world, name, k) for name in stack])
    points, forces, owners = _forces(world, stack, k)
    if not len(points):
        return False
    weights = masses / masses.max()
    return all(_balanced(points, forces, owners, weights, centers + offset) for offset in OFFSETS)


def _forces(world: World, stack: Sequence[str], k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of friction cones between the bodies of a stack, and with all others.

    Returns:
        Where they act (m, 3), the forces (m, 3), and (m, 2) numbers of the bodies on which each acts, and reacts; -1
        for one outside of the stack.
    """
    points, forces, owners = [], [], []
    for on, name in enumerate(stack):
        others = [part for part in world.parts if part.link is None and part.holder != name]
        for a, b in product(world.parts_of(name), others):
            by = stack.index(b.holder) if b.holder in stack else -1
            if by > on or (by < 0 and not world.document.bodies[b.holder].fixed):
                continue  # each pair once
            _, corners, normal = touch(world, a, b, k)
            if not len(corners):
                continue
            friction = limits.REST_FRICTION * friction_of(world, name, b.holder)
            for point, force in product(corners, cone(normal, friction)):
                points.append(point)
                forces.append(force)
                owners.append((on, by))
    return np.array(points), np.array(forces), np.array(owners)


def _balanced(
    points: np.ndarray, forces: np.ndarray, owners: np.ndarray, weights: np.ndarray, centers: np.ndarray
) -> bool:
    """Whether a combination of forces with positive factors balances the weights (n,) at centres (n, 3)."""
    n, m = len(weights), len(points)
    rows = np.zeros((n, 6, m))
    for column, sign in ((0, 1.0), (1, -1.0)):
        chosen = np.flatnonzero(owners[:, column] >= 0)
        body = owners[chosen, column]
        arms = points[chosen] - centers[body]
        rows[body, :3, chosen] += sign * forces[chosen]
        rows[body, 3:, chosen] += sign * np.cross(arms, forces[chosen])
    rows[:, 3:] /= max(float(np.abs(rows[:, 3:]).max()), TINY)
    needed = np.zeros((n, 6))
    needed[:, 2] = weights
    return balance(rows.reshape(6 * n, m), needed.ravel())
