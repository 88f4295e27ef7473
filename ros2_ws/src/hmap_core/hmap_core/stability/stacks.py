"""Whether a stack of bodies stays as it is when one more body is placed on it: the equilibrium of all of them.

A body can stand well on another one that then tips: on the end of a board that sticks out over an edge.
"""

from collections.abc import Mapping

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance, transformed
from hmap_core.stability.contact_patches import TOUCHING, patches
from hmap_core.stability.equilibrium import Contact, in_equilibrium
from hmap_core.stability.mass import centre_of_mass
from hmap_core.stability.rest import FRICTION_SHARE
from hmap_core.transforms import IDENTITY, apply
from hmap_core.types import Body, BodyKind

OFF_CENTRE = (
    0.002  # m, by which all centres of mass may be off in any level direction; the judge asks for a little less
)
_DOWN = np.array([0.0, 0.0, -1.0])
_OFFSETS = OFF_CENTRE * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])


def stack_tips(bodies: Mapping[str, Body], name: str, T: np.ndarray) -> tuple[str, ...]:
    """The bodies of a stack that does not stay once a body is placed on it; empty if it stays.

    A body that touches nothing but fixed bodies is no stack: whether it stands there by itself is not asked. Nor is a
    stack judged that does not stay without the body, as measured bodies may be a little off each other.

    Args:
        bodies: all bodies at their own poses, those on which it may be placed among them.
        name: of the body that is placed.
        T: (7,) where it is placed, world frame.
    """
    shapes = {other: transformed(convex_set(body.shapes), body.pose) for other, body in bodies.items() if other != name}
    shapes[name] = transformed(convex_set(bodies[name].shapes), T)
    stack = _joined(bodies, shapes, name)
    if len(stack) < 2:
        return ()
    poses = {n: T if n == name else bodies[n].pose for n in stack}
    if not _stays(bodies, shapes, poses, stack[1:]) or _stays(bodies, shapes, poses, stack):
        return ()
    return tuple(stack)


def _stays(
    bodies: Mapping[str, Body], shapes: Mapping[str, ConvexSet], poses: Mapping[str, np.ndarray], stack: list[str]
) -> bool:
    """Whether the bodies of a stack are in equilibrium at poses (7,), nothing else standing on them."""
    contacts = _contacts(bodies, shapes, stack)
    centres = np.array([apply(poses[n], centre_of_mass(convex_set(bodies[n].shapes))) for n in stack])
    masses = [bodies[n].mass for n in stack]
    return all(in_equilibrium(masses, centres + offset, contacts, _DOWN) for offset in _OFFSETS)


def _joined(bodies: Mapping[str, Body], shapes: Mapping[str, ConvexSet], name: str) -> list[str]:
    """The movable bodies that touch a body, and those that touch these; the body itself first."""
    loose = [other for other, body in bodies.items() if body.kind != BodyKind.FIXED and other != name]
    stack = [name]
    for own in stack:
        found = [other for other in loose if other not in stack and _touch(shapes[own], shapes[other])]
        stack += found
    return stack


def _touch(a: ConvexSet, b: ConvexSet) -> bool:
    return set_distance(a, IDENTITY, b, IDENTITY, 2.0 * TOUCHING) <= TOUCHING


def _contacts(bodies: Mapping[str, Body], shapes: Mapping[str, ConvexSet], stack: list[str]) -> list[Contact]:
    """The patches between the bodies of a stack, and with what is fixed."""
    found = []
    for on, own in enumerate(stack):
        for other, body in bodies.items():
            fixed = body.kind == BodyKind.FIXED
            if not fixed and (other not in stack or stack.index(other) >= on):
                continue  # each pair once
            friction = FRICTION_SHARE * min(bodies[own].friction, body.friction)
            by = None if fixed else stack.index(other)
            found += [Contact(patch, on, by) for patch in patches(shapes[own], shapes[other], friction)]
    return found
