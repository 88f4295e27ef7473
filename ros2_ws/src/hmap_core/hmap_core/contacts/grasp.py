"""Grasps: two fingers on opposite faces of the object."""

from collections.abc import Callable

import numpy as np
from numba import njit

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import (
    SHALLOWEST,
    Candidates,
    Hand,
    HandPoses,
    Situation,
    clear_of_palm,
    frames,
    tangents,
)
from hmap_core.contacts.solids import Solids, outward_normal, way_out
from hmap_core.deadline import check_time
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactKind

# the opening stays this much below the gripper's largest one, m
WIDTH_CLEARANCE = 5e-4
AT_ONCE = 150_000  # points times shapes that are looked at between two looks at the clock
# number of approach directions about the closing axis
APPROACHES = 12
# grasp depth beyond which the score does not increase, m
DEEP = 0.01
# fingertips stay this much above what the object stands on, m; a little more than robots keep from what stands around
OFF_FLOOR = 0.0035
# cosine between approach and vertical for which drawing back lifts the fingertips
LEAST_DOWN = 0.5


@njit(cache=True, error_model="numpy", nogil=True)
def across(points, normals, kind, R, p, size, planes, start):
    """Width of the material behind each point.

    Returns:
        Width (N,) in m along -normal, and the outward normals (N, 3) of the far side.
    """
    width = np.zeros(points.shape[0])
    far = np.zeros(points.shape)
    for i in range(points.shape[0]):
        width[i], s = way_out(points[i], -normals[i], kind, R, p, size, planes, start)
        if s >= 0:
            far[i] = outward_normal(s, points[i] - width[i] * normals[i], kind, R, p, size, planes, start)
    return width, far


@njit(cache=True, error_model="numpy", nogil=True)
def depth_below(points, directions, kind, R, p, size, planes, start):
    """Extent (N,) of the material from inner points along the directions (N, 3), m."""
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        out[i], _ = way_out(points[i], directions[i], kind, R, p, size, planes, start)
    return out


def _depths(points: np.ndarray, directions: np.ndarray, own: Solids) -> np.ndarray:
    """:func:`depth_below` of many points, which looks at the clock in between."""
    found = []
    for some in np.array_split(np.arange(len(points)), len(points) * len(own) // AT_ONCE + 1):
        check_time()
        found.append(depth_below(points[some], directions[some], *own.arrays))
    return np.concatenate(found)


def antipodal(cloud: Cloud, own: Solids, hand: Hand, friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Find antipodal grasp points.

    Args:
        cloud: surface points, object frame.
        own: the object's shapes.
        hand: its gripper limits the width.
        friction: coefficient of the object.

    Returns:
        (N,) whether the opposite face is within the friction cone and the gripper's range, and widths (N,) in m.
    """
    width, far = across(cloud.points, cloud.normals, *own.arrays)
    opposite = -np.einsum("ij,ij->i", far, cloud.normals) >= np.cos(np.arctan(friction))
    return opposite & fits_between(width, hand), width


def fits_between(width: np.ndarray, hand: Hand) -> np.ndarray:
    """Whether widths (N,) in m are within the gripper's range."""
    gripper = hand.require_gripper()
    return (width >= max(gripper.min_opening, 2 * WIDTH_CLEARANCE)) & (width <= gripper.max_opening - WIDTH_CLEARANCE)


def _off_floor(
    z: np.ndarray, y: np.ndarray, middle: np.ndarray, hand: Hand, T_world_obj: np.ndarray, floor: float
) -> np.ndarray:
    """Distance (N,) in m that grasps draw back so that the fingertips stay off the floor; 0 where that is too far.

    Args:
        z, y: (N, 3) directions of approach and closing, object frame.
        middle: (N, 3) middle between the pads, object frame, m.
        hand: its fingers.
        T_world_obj: (7,) the object's pose.
        floor: its height, m.
    """
    gripper, R = hand.require_gripper(), rotation_matrix(T_world_obj)
    down, across = -(z @ R[2]), np.abs(np.cross(y, z) @ R[2])
    tip = middle @ R[2] + T_world_obj[2] - gripper.tip_offset * down - gripper.pad_half_width * across
    needed = np.maximum(floor + OFF_FLOOR - tip, 0.0) / np.maximum(down, LEAST_DOWN)
    return np.where((down >= LEAST_DOWN) & (needed <= SHALLOWEST * gripper.tip_offset), needed, 0.0)


# surface points, the object's shapes, hand, friction -> whether a face lies opposite (N,), width (N,) in m
Opposite = Callable[[Cloud, Solids, Hand, float], tuple[np.ndarray, np.ndarray]]


def grasps(
    cloud: Cloud,
    own: Solids,
    centre: np.ndarray,
    radius: float,
    hand: Hand,
    friction: float,
    allowed: Callable[[np.ndarray], np.ndarray],
    situation: Situation,
    opposite: Opposite = antipodal,
    floor: float = -np.inf,
) -> Candidates:
    """Grasps at points with an opposite face, from APPROACHES directions and with both orientations of the hand.

    The closing axis is the normal. The frame's origin is midway between the faces; the grasp is less deep if the object
    would touch the palm, or the fingertips what the object stands on.

    Args:
        cloud: surface points, object frame.
        own: the object's shapes.
        centre: (3,) the object's centre of mass, object frame, m.
        radius: the object's radius about it, m.
        hand: the fingers.
        friction: coefficient of the object.
        allowed: maps points (N, 3) to whether contacts can lie there (N,).
        situation: the object's pose and motion, and the robot's position.
        opposite: finds the points with an opposite face, and the widths there.
        floor: height of what the object stands on, world frame, m.
    """
    good, width = opposite(cloud, own, hand, friction)
    good &= allowed(cloud.points - width[:, None] * cloud.normals)
    turns, sides = 2.0 * np.pi * np.arange(APPROACHES) / APPROACHES, np.array([1.0, -1.0])
    count = APPROACHES * len(sides)
    points, normals = (np.repeat(a[good], count, axis=0) for a in (cloud.points, cloud.normals))
    width = np.repeat(width[good], count)
    turn = np.tile(np.repeat(turns, len(sides)), good.sum())
    y = normals * np.tile(sides, good.sum() * APPROACHES)[:, None]
    down, other = tangents(normals, -rotation_matrix(situation.T_world_obj)[2])
    z = np.cos(turn)[:, None] * down + np.sin(turn)[:, None] * other
    R = frames(z, np.cross(y, z))
    middle = points - 0.5 * width[:, None] * normals
    above = _depths(middle, np.ascontiguousarray(-z), own)
    check_time()
    shallower, keep = clear_of_palm(above, hand)
    shallower = np.maximum(shallower, _off_floor(z, y, middle, hand, situation.T_world_obj, floor))
    origin = middle - z * shallower[:, None]
    score = (
        scoring.W_CENTRAL * scoring.central(middle, centre, radius)
        + scoring.W_ABOVE * scoring.above(z, situation.T_world_obj)
        + scoring.W_DEEP * np.minimum(above / DEEP, 1.0)
        + scoring.W_NEAR * scoring.near(points, situation, radius)
        + scoring.W_SEEN * np.repeat(cloud.seen[good], count)
    )
    approach = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    poses = HandPoses(R, origin, width, approach)[keep]
    z, points, normals, score = (a[keep] for a in (z, points, normals, score))
    return Candidates(ContactKind.GRASP, z, points, normals, score, poses.__getitem__)
