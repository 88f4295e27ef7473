"""Touches: a fingertip, or an attached body, on the object's surface (the contact of kinematic tasks)."""

import numpy as np

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, HandPoses, Situation, frames, on_surface, tangents
from hmap_core.contacts.facets import attached_facets, facet_poses
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactKind

# angles between the finger and the normal, rad
TILTS = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0])
# number of directions of the tilt about the normal, and of rotations of the hand about its approach
AZIMUTHS = 12
ROLLS = 8
# orientations tried at each point
PER_POINT = 12


def touches(
    cloud: Cloud, centre: np.ndarray, radius: float, hand: Hand, situation: Situation, rng: np.random.Generator
) -> Candidates:
    """Touches at every point of the cloud, in PER_POINT orientations drawn from the tilts, azimuths and rolls.

    Args:
        cloud: surface points, object frame.
        centre: (3,) the object's centre of mass, object frame, m.
        radius: the object's radius about it, m.
        hand: the fingers, or the attached body.
        situation: the object's pose and motion, and the robot's position.
        rng: the only source of randomness.
    """
    found = _attached_poses if hand.attached else _finger_poses
    toward, index, straight, placed_hand = found(cloud, rotation_matrix(situation.T_world_obj)[2], hand, rng)
    points, normals = cloud.points[index], cloud.normals[index]
    places = scoring.position_score(cloud.points, cloud.normals, cloud.seen, centre, radius, situation)
    score = places[index] + scoring.W_ABOVE * scoring.above(toward, situation.T_world_obj) + straight

    def poses(chosen: np.ndarray) -> HandPoses:
        R, origin = placed_hand(chosen)
        approach = -np.einsum("nij,ni->nj", R, normals[chosen])
        return HandPoses(R, origin, np.full(len(R), hand.closed), approach)

    return Candidates(ContactKind.TOUCH, toward, points, normals, score, poses)


def _finger_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """Touches of the fingertip.

    Returns:
        Directions (N, 3) of the hand, indices (N,) of the touched points, scores (N,) for how perpendicular the finger
        is, and a function from indices to poses R (n, 3, 3), origin (n, 3).
    """
    n = len(cloud) * PER_POINT
    index = np.repeat(np.arange(len(cloud)), PER_POINT)
    tilt = rng.choice(TILTS, n)
    azimuth = 2.0 * np.pi * rng.integers(AZIMUTHS, size=n) / AZIMUTHS
    roll = 2.0 * np.pi * rng.integers(ROLLS, size=n) / ROLLS
    toward, lean = tilted(cloud.normals, up, index, tilt, azimuth)

    def placed_hand(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R = turned_frames(toward[chosen], lean[chosen], roll[chosen])
        touched = index[chosen]
        return R, on_surface(R, cloud.points[touched], cloud.normals[touched], hand.tip, hand.tip_radius)[0]

    return toward, index, scoring.W_STRAIGHT * np.cos(tilt), placed_hand


def _attached_poses(cloud: Cloud, up: np.ndarray, hand: Hand, rng: np.random.Generator):
    """Touches of the attached body's facets; as :func:`_finger_poses`, with scores for how upright the body is."""
    attached = hand.require_attached()
    own_up = rotation_matrix(attached.T_ee_body) @ attached.up
    found = []
    for facet in attached_facets(attached):
        R, origin, upright, index = facet_poses(facet, own_up, cloud.points, cloud.normals, up, rng)
        found.append((R, origin, index, scoring.W_UPRIGHT * upright))
    R, origin, index, upright = (np.concatenate(a) for a in zip(*found, strict=True))
    return R[:, :, 2], index, upright, lambda chosen: (R[chosen], origin[chosen])


def tilted(
    normals: np.ndarray, up: np.ndarray, index: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions at an angle to inward normals.

    Args:
        normals: (M, 3) outward unit normals.
        up: (3,) the azimuth is measured from the tangent that is nearest to this direction.
        index: (N,) which normals to use.
        tilt: (N,) angles to -normals, rad.
        azimuth: (N,) angles about the normal, rad.

    Returns:
        Directions (N, 3), and the axes (N, 3) that they are tilted about.
    """
    first, second = (tangent[index] for tangent in tangents(normals, up))
    normals = normals[index]
    lean = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
    return -normals * np.cos(tilt)[:, None] - np.cross(lean, normals) * np.sin(tilt)[:, None], lean


def turned_frames(toward: np.ndarray, lean: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Frames (N, 3, 3) with z axes ``toward`` (N, 3); their x axes are ``lean`` (N, 3) rotated by ``roll`` (N,) rad."""
    x = np.cos(roll)[:, None] * lean + np.sin(roll)[:, None] * np.cross(toward, lean)
    return frames(toward, x)
