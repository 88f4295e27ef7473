"""Whether a body stays where it is released: on faces, in a cradle, leaning, or kept by what stands around.

A body rests if it is in equilibrium under gravity that is tilted by a little in any direction, there or no farther than
ROLL_ROOM away: a ball on a level plate rolls, but not out of a ring.
"""

from collections.abc import Sequence

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance, transformed
from hmap_core.stability.contact_patches import TOUCHING, patches
from hmap_core.stability.equilibrium import Contact, in_equilibrium
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, apply
from hmap_core.types import Body

# of gravity, which a body at rest has to resist; more than half the angle between two sides of a cylinder's polygon
TILT = float(np.tan(np.deg2rad(6.0)))
DIRECTIONS = 8  # in which gravity is tilted
ROLL_ROOM = 0.02  # m that a body may roll or slide until something stops it
ROLL_STEP = 1e-3  # m
PENETRATION = 1e-3  # m that a body may be inside another one
FRICTION_SHARE = 0.8  # of the friction coefficient that is relied on


def rests(body: Body, T: np.ndarray, around: Sequence[Body]) -> bool:
    """Whether a body at T (7,) stays there, or within ROLL_ROOM, when it is released.

    Args:
        body: its shapes and friction.
        T: (7,) T_world_body.
        around: bodies that stand, at their own poses.
    """
    own = convex_set(body.shapes)
    near = [(other, transformed(convex_set(other.shapes), other.pose)) for other in around]
    moved = transformed(own, T)
    reach = 2.0 * ROLL_ROOM
    near = [(other, shapes) for other, shapes in near if set_distance(moved, IDENTITY, shapes, IDENTITY, reach) < reach]
    if not any(set_distance(moved, IDENTITY, shapes, IDENTITY, TOUCHING) <= TOUCHING for _, shapes in near):
        return False
    centre = apply(T, centre_of_mass(own))
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    return all(_stops(body, own, T, centre, near, np.array([np.cos(a), np.sin(a)])) for a in angles)


def _stops(
    body: Body,
    own: ConvexSet,
    T: np.ndarray,
    centre: np.ndarray,
    near: Sequence[tuple[Body, ConvexSet]],
    way: np.ndarray,
) -> bool:
    """Whether a body comes to rest within ROLL_ROOM if gravity is tilted along a horizontal direction (2,)."""
    gravity = np.array([*(TILT * way), -1.0])
    known = 0  # patches at the last step; with the same ones, the body rolls on
    for step in np.arange(0.0, ROLL_ROOM + ROLL_STEP, ROLL_STEP):
        offset = np.array([*(step * way), 0.0])
        moved = transformed(own, np.concatenate([T[:3] + offset, T[3:]]))
        if step > 0.0:
            inside = min(set_distance(moved, IDENTITY, shapes, IDENTITY, 0.0) for _, shapes in near)
            if inside < -2.0 * PENETRATION:
                return False
        found = [
            Contact(patch, 0)
            for other, shapes in near
            for patch in patches(moved, shapes, FRICTION_SHARE * min(body.friction, other.friction))
        ]
        if len(found) != known and in_equilibrium([1.0], (centre + offset)[None], found, gravity):
            return True
        known = len(found)
    return False
