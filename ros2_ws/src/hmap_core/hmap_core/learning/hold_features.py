"""The numbers from which the model scores a manipulator: a bare hand, or a hold on a tool, for an object's path."""

import numpy as np

from hmap_core.collision.convex import convex_set
from hmap_core.learning.features import COMMON, LIMIT, SCALE
from hmap_core.learning.situation import PLACES, PathSituation
from hmap_core.transforms import apply, rotation_matrix

DIRECTIONS = 16  # in which a push is compared with the path
BEHIND = (0.02, 0.06, 0.12, 0.2, 0.3)  # m behind the object at which there may be room
BESIDE = (0.02, 0.06, 0.12)
ABOVE = (0.03, 0.08, 0.16)
LOOKED_AT = 2  # places of the path, the first and the middle one
HAND = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.06], [0.0, 0.09, 0.08], [0.0, -0.09, 0.08], [-0.06, 0.0, 0.12]])
SHAFT = (0.25, 0.5, 0.75)  # shares of the way from the object to the hand
OWN = 12  # numbers of the hold itself
PER_PLACE = len(BEHIND) + 2 * len(BESIDE) + len(ABOVE) + len(HAND) + len(SHAFT) + 1
WIDTH = COMMON + 2 + OWN + LOOKED_AT * PER_PLACE + PLACES
NAMES = tuple(f"hold_{k}" for k in range(WIDTH))


def hold_features(situation: PathSituation) -> np.ndarray:
    """Features (WIDTH,) of the robot as it is: with its bare hand, or with the tool that it holds; float32."""
    own, reach, below = _hold(situation)
    found = [situation.common, _pushes(situation), own]
    for place in (0, 2):
        found.append(_around(situation, place, reach, below))
    found.append(_stretch(situation, reach, below))
    return np.concatenate(found, dtype=np.float32)


def _hold(situation: PathSituation) -> tuple[np.ndarray, float, float]:
    """Numbers (OWN,) of the hold, how far the tool reaches beyond the hand, and how far it is below it, m."""
    attached = situation.attached
    if attached is None:
        return np.zeros(OWN), 0.0, 0.02
    up = attached.up / np.linalg.norm(attached.up)
    R_ee = rotation_matrix(attached.T_ee_body)
    up_ee = R_ee @ up
    vertices = apply(attached.T_ee_body, convex_set(attached.shapes).vertices)
    heights = vertices @ up_ee
    flat = vertices - heights[:, None] * up_ee
    far = np.linalg.norm(flat, axis=1)
    farthest = flat[far.argmax()] / max(float(far.max()), 1e-9)
    across = np.cross(up_ee, farthest)
    sides, along = flat @ across, flat @ farthest
    own = [
        SCALE * far.max(),
        SCALE * -along.min(),
        SCALE * -heights.min(),
        SCALE * heights.max(),
        SCALE * np.ptp(sides),
        SCALE * np.abs(sides).max(),
        -up_ee[2],
        farthest[2],
        abs(farthest[1]),
        SCALE * attached.opening,
        attached.friction,
        attached.mass,
    ]
    return np.array(own), float(far.max()), float(-heights.min())


def _pushes(situation: PathSituation) -> np.ndarray:
    """Share of the path that the best of some directions, and that the first direction, can push."""
    directions, _ = situation.pushing
    if not len(directions):
        return np.ones(2)
    up = situation.R_places[0][2]
    first = directions[0]
    across = np.cross(up, first)
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, DIRECTIONS)
    normals = -(np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * across)
    return np.array([situation.pushed_share(normals).max(), situation.pushed_share(-first[None])[0]])


def _way(situation: PathSituation, place: int) -> np.ndarray:
    """Horizontal unit direction (3,) in which the object leaves a place, world frame."""
    way = situation.steps[min(place, len(situation.steps) - 1)] @ situation.axes
    way = np.array([way[0], way[1], 0.0])
    length = float(np.linalg.norm(way))
    return way / length if length > 1e-6 else situation.axes[0]


def _behind(situation: PathSituation, way: np.ndarray) -> tuple[float, float, float]:
    """How far the object extends against the way, and beside it, and up, from its origin at its first pose, m."""
    corners = situation.corners @ situation.R_places[0].T
    left = np.array([-way[1], way[0], 0.0])
    return float(-(corners @ way).min()), float(np.abs(corners @ left).max()), float(corners[:, 2].max())


def _around(situation: PathSituation, place: int, reach: float, below: float) -> np.ndarray:
    """Distances (PER_PLACE,) of points round the object, and of hand and tool behind it, from what stands around."""
    way = _way(situation, place)
    left, up = np.array([-way[1], way[0], 0.0]), np.array([0.0, 0.0, 1.0])
    back, beside, above = _behind(situation, way)
    origin = situation.poses[situation.places[place], :3]
    low = situation.extents[0, 2]
    hand = origin - (back + reach) * way + (low + below) * up
    contact = origin - back * way + max(low + 0.02, 0.0) * up
    points = [origin - (back + far) * way for far in BEHIND]
    points += [origin + side * (beside + far) * left for far in BESIDE for side in (-1.0, 1.0)]
    points += [origin + (above + far) * up for far in ABOVE]
    points += [hand + x * way + y * left + z * up for x, y, z in HAND]
    points += [contact + share * (hand - contact) for share in SHAFT]
    points.append(hand - 0.1 * way)
    return SCALE * situation.boxes.distances(np.array(points), 2.0 * LIMIT)


def _stretch(situation: PathSituation, reach: float, below: float) -> np.ndarray:
    """How far (PLACES,) the arm stretches with the hand behind the object, by its span."""
    found = []
    for place in range(PLACES):
        way = _way(situation, place)
        back, _, _ = _behind(situation, way)
        hand = situation.poses[situation.places[place], :3] - (back + reach) * way
        hand[2] += situation.extents[0, 2] + below
        found.append(float(np.linalg.norm(hand - situation.shoulder)) / situation.span)
    return np.array(found)
