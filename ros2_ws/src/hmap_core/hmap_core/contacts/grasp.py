"""Grasps: two fingers on opposite faces of the object."""

import numpy as np
from numba import njit

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, HandPoses, Situation, frames, tangents
from hmap_core.contacts.solids import Solids, outward_normal, way_out
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactKind

# the opening keeps this to the widest the gripper can do, m
WIDTH_CLEARANCE = 5e-4
# directions of approach about the closing axis
APPROACHES = 12
# the fingers are put this share of their tip length less deep at most, to keep the palm clear
SHALLOWEST = 0.5
# material this far up along the pads is held as well as any more, m
DEEP = 0.01


@njit(cache=True, error_model="numpy", nogil=True)
def across(points, normals, kind, R, p, size, planes, start):
    """Width (N,) of the material behind each point along -normal, and the outward normals (N, 3) on the far side."""
    width = np.zeros(points.shape[0])
    far = np.zeros(points.shape)
    for i in range(points.shape[0]):
        width[i], s = way_out(points[i], -normals[i], kind, R, p, size, planes, start)
        if s >= 0:
            far[i] = outward_normal(s, points[i] - width[i] * normals[i], kind, R, p, size, planes, start)
    return width, far


@njit(cache=True, error_model="numpy", nogil=True)
def depth_below(points, directions, kind, R, p, size, planes, start):
    """How far (N,) the material reaches from inner points along the directions (N, 3)."""
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        out[i], _ = way_out(points[i], directions[i], kind, R, p, size, planes, start)
    return out


def antipodal(cloud: Cloud, own: Solids, hand: Hand, friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Which points (N,) have an opposite face that the gripper can reach round and hold, and their widths (N,) in m."""
    width, far = across(cloud.points, cloud.normals, *own.arrays)
    opposite = -np.einsum("ij,ij->i", far, cloud.normals) >= np.cos(np.arctan(friction))
    gripper = hand.gripper
    fits = (width >= max(gripper.min_opening, 2 * WIDTH_CLEARANCE)) & (width <= gripper.max_opening - WIDTH_CLEARANCE)
    return opposite & fits, width


def grasps(
    cloud: Cloud,
    own: Solids,
    centre: np.ndarray,
    radius: float,
    hand: Hand,
    friction: float,
    allowed,
    situation: Situation,
) -> Candidates:
    """Grasps at the points of the cloud with an opposite face, from APPROACHES directions, the hand either way round.

    The closing axis is the normal; the frame's origin is midway between the faces, less deep where the object would
    meet the palm. ``allowed`` maps points (N, 3) to whether contacts may lie there (N,).
    """
    good, width = antipodal(cloud, own, hand, friction)
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
    above = depth_below(middle, np.ascontiguousarray(-z), *own.arrays)
    over = above - hand.palm_clearance
    shallower = np.maximum(over, 0.0)
    keep = shallower <= SHALLOWEST * hand.gripper.tip_offset
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
    return Candidates(ContactKind.GRASP, *(a[keep] for a in (z, points, normals, score)), poses.__getitem__)
