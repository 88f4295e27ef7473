"""Touches: a fingertip, or a held body, on the surface (the contact of the kinematic tasks)."""

import numpy as np

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, Situation, frames, on_surface, tangents
from hmap_core.contacts.facets import held_facets, placed
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactKind

# angles between the finger and the normal, rad
TILTS = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0])
# directions of the tilt about the normal, and turns of the hand about its approach
AZIMUTHS = 12
ROLLS = 8
# orientations tried at each point
PER_POINT = 12


def touches(
    cloud: Cloud, centre: np.ndarray, radius: float, hand: Hand, situation: Situation, rng: np.random.Generator
) -> Candidates:
    """Touches at every point of the cloud, in PER_POINT orientations drawn from the tilts, azimuths and rolls."""
    poses = _held_poses if hand.held else _finger_poses
    R, origin, index, straight = poses(cloud, rotation_matrix(situation.T_world_obj)[2], hand, rng)
    points, normals = cloud.points[index], cloud.normals[index]
    score = scoring.place(R, points, normals, cloud.seen[index], centre, radius, situation) + straight
    approach = -np.einsum("nij,ni->nj", R, normals)
    return Candidates(ContactKind.TOUCH, R, origin, points, normals, np.full(len(R), hand.closed), approach, score)


def _finger_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """Poses R (N, 3, 3), origin (N, 3), the points they touch (N,), and how straight (N,) the finger stands on them."""
    n = len(cloud) * PER_POINT
    index = np.repeat(np.arange(len(cloud)), PER_POINT)
    points, normals = cloud.points[index], cloud.normals[index]
    tilt = rng.choice(TILTS, n)
    azimuth = 2.0 * np.pi * rng.integers(AZIMUTHS, size=n) / AZIMUTHS
    roll = 2.0 * np.pi * rng.integers(ROLLS, size=n) / ROLLS
    R = tilted_frames(normals, up, tilt, azimuth, roll)
    origin, _ = on_surface(R, points, normals, hand.tip)
    return R, origin, index, scoring.W_STRAIGHT * np.cos(tilt)


def _held_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """The same with facets of what the hand holds, and how upright (N,) that is."""
    own_up = rotation_matrix(hand.held.T_ee_body) @ hand.held.up
    found = []
    for facet in held_facets(hand.held):
        R, origin, upright, index = placed(facet, own_up, cloud.points, cloud.normals, up, rng)
        found.append((R, origin, index, scoring.W_UPRIGHT * upright))
    return (np.concatenate(a) for a in zip(*found, strict=True))


def tilted_frames(
    normals: np.ndarray, up: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray, roll: np.ndarray
) -> np.ndarray:
    """Frames (N, 3, 3) whose z leans by ``tilt`` from -normal in the direction ``azimuth`` and is turned by ``roll``.

    Azimuth 0 leans about the tangent nearest to ``up`` (3,). All angles (N,) in rad.
    """
    first, second = tangents(normals, up)
    lean = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
    z = -normals * np.cos(tilt)[:, None] - np.cross(lean, normals) * np.sin(tilt)[:, None]
    x = np.cos(roll)[:, None] * lean + np.sin(roll)[:, None] * np.cross(z, lean)
    return frames(z, x)
