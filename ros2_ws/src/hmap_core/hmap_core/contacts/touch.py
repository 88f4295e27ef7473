"""Touches: a fingertip on the surface (the contact of the kinematic tasks)."""

import numpy as np

from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, Situation, frames, on_surface, tangents
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
    n = len(cloud) * PER_POINT
    points, normals = (np.repeat(a, PER_POINT, axis=0) for a in (cloud.points, cloud.normals))
    tilt = rng.choice(TILTS, n)
    azimuth = 2.0 * np.pi * rng.integers(AZIMUTHS, size=n) / AZIMUTHS
    roll = 2.0 * np.pi * rng.integers(ROLLS, size=n) / ROLLS
    R = tilted_frames(normals, rotation_matrix(situation.T_world_obj)[2], tilt, azimuth, roll)
    origin, _ = on_surface(R, points, normals, hand.tip)
    score = (
        scoring.W_CENTRAL * scoring.central(points, centre, radius)
        + scoring.W_ABOVE * scoring.above(R, situation.T_world_obj)
        + scoring.W_NEAR * scoring.near(points, situation, radius)
        + scoring.W_MOTION * scoring.along(normals, situation)
        + scoring.W_SEEN * np.repeat(cloud.seen, PER_POINT)
        + scoring.W_STRAIGHT * np.cos(tilt)
    )
    approach = -np.einsum("nij,ni->nj", R, normals)
    return Candidates(ContactKind.TOUCH, R, origin, points, normals, np.zeros(n), approach, score)


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
