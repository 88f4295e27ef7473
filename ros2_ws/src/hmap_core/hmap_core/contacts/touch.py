"""Touches: a fingertip, or a held body, on the surface (the contact of the kinematic tasks)."""

import numpy as np

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, HandPoses, Situation, frames, on_surface, tangents
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
    found = _held_poses if hand.attached else _finger_poses
    toward, index, straight, placed_hand = found(cloud, rotation_matrix(situation.T_world_obj)[2], hand, rng)
    points, normals = cloud.points[index], cloud.normals[index]
    places = scoring.place(cloud.points, cloud.normals, cloud.seen, centre, radius, situation)
    score = places[index] + scoring.W_ABOVE * scoring.above(toward, situation.T_world_obj) + straight

    def poses(chosen: np.ndarray) -> HandPoses:
        R, origin = placed_hand(chosen)
        approach = -np.einsum("nij,ni->nj", R, normals[chosen])
        return HandPoses(R, origin, np.full(len(R), hand.closed), approach)

    return Candidates(ContactKind.TOUCH, toward, points, normals, score, poses)


def _finger_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """Where the hand points (N, 3), the points it touches (N,), how straight (N,) the finger stands on them; and what
    maps indices to poses R (n, 3, 3), origin (n, 3)."""
    n = len(cloud) * PER_POINT
    index = np.repeat(np.arange(len(cloud)), PER_POINT)
    tilt = rng.choice(TILTS, n)
    azimuth = 2.0 * np.pi * rng.integers(AZIMUTHS, size=n) / AZIMUTHS
    roll = 2.0 * np.pi * rng.integers(ROLLS, size=n) / ROLLS
    toward, lean = tilted(cloud.normals, up, index, tilt, azimuth)

    def placed_hand(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R = turned_frames(toward[chosen], lean[chosen], roll[chosen])
        touched = index[chosen]
        return R, on_surface(R, cloud.points[touched], cloud.normals[touched], hand.tip)[0]

    return toward, index, scoring.W_STRAIGHT * np.cos(tilt), placed_hand


def _held_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """The same with facets of what the hand holds, and how upright (N,) that is."""
    own_up = rotation_matrix(hand.attached.T_ee_body) @ hand.attached.up
    found = []
    for facet in held_facets(hand.attached):
        R, origin, upright, index = placed(facet, own_up, cloud.points, cloud.normals, up, rng)
        found.append((R, origin, index, scoring.W_UPRIGHT * upright))
    R, origin, index, upright = (np.concatenate(a) for a in zip(*found, strict=True))
    return R[:, :, 2], index, upright, lambda chosen: (R[chosen], origin[chosen])


def tilted(
    normals: np.ndarray, up: np.ndarray, index: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) that lean by ``tilt`` from -normals[index], and what they lean about.

    That is the tangent nearest to ``up`` (3,), turned by ``azimuth``. All angles (N,) in rad.
    """
    first, second = (tangent[index] for tangent in tangents(normals, up))
    normals = normals[index]
    lean = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
    return -normals * np.cos(tilt)[:, None] - np.cross(lean, normals) * np.sin(tilt)[:, None], lean


def turned_frames(toward: np.ndarray, lean: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Frames (N, 3, 3) with these z axes, whose x axes are turned by ``roll`` (N,), in rad, from ``lean`` (N, 3)."""
    x = np.cos(roll)[:, None] * lean + np.sin(roll)[:, None] * np.cross(toward, lean)
    return frames(toward, x)
