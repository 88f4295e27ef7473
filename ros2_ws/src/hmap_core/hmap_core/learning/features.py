"""The numbers from which the model scores one contact. They do not change where the whole scene is moved or turned."""

from collections.abc import Sequence

import numpy as np

from hmap_core.learning.situation import PLACES, PathSituation, tool_points
from hmap_core.transforms import rotation_matrices
from hmap_core.types import ContactKind, ContactPoint

LIMIT = 0.12  # m: distances beyond it do not matter
SCALE = 10.0  # per m, of lengths
KINDS = (ContactKind.TOUCH, ContactKind.GRASP, ContactKind.PUSH, ContactKind.PRESS)
# points of a hand, end-effector frame: between the tips, the sides of the palm, the palm, the wrist; m
HAND = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.0, 0.095, -0.07],
        [0.0, -0.095, -0.07],
        [0.03, 0.0, -0.07],
        [-0.03, 0.0, -0.07],
        [0.0, 0.0, -0.15],
        [0.0, 0.0, -0.25],
    ]
)
FINGERS = 2  # points beside the tips, whose distance is the opening
TOOL = 7  # points of a tool
PROBES = len(HAND) + FINGERS + TOOL
BACK = 0.08  # m: how far along the approach the hand comes from
STOPS = PLACES + 1  # at which the hand is looked at: the place before the contact, and the places of the path
OWN = 30  # numbers of the contact itself
COMMON = 14 + 4 * (PLACES - 1)
WIDTH = COMMON + OWN + len(HAND) + PROBES * STOPS
NAMES = (
    *(f"common_{k}" for k in range(COMMON)),
    *(f"own_{k}" for k in range(OWN)),
    *(f"object_clearance_{k}" for k in range(len(HAND))),
    *(f"clearance_{stop}_{probe}" for stop in range(STOPS) for probe in range(PROBES)),
)


def contact_features(situation: PathSituation, contacts: Sequence[ContactPoint]) -> np.ndarray:
    """Features (K, WIDTH) of K contacts, float32."""
    K = len(contacts)
    if not K:
        return np.zeros((0, WIDTH), np.float32)
    frames = np.array([contact.T_obj_ee for contact in contacts])
    R = rotation_matrices(frames)
    own = _own(situation, contacts, frames[:, :3], R)
    common = np.broadcast_to(situation.common, (K, COMMON))
    from_object = _from_object(situation, frames[:, :3], R)
    around = _clearances(situation, contacts, frames[:, :3], R)
    return np.concatenate([common, own, from_object, around], axis=1, dtype=np.float32)


def _own(situation: PathSituation, contacts: Sequence[ContactPoint], p: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Numbers (K, OWN) of the contacts themselves."""
    K = len(contacts)
    to_axes = situation.axes @ situation.R_places[0]
    hand = to_axes @ R
    approach = np.einsum("kij,kj->ki", hand, np.array([c.approach for c in contacts]))
    normal_own = np.array([c.normal for c in contacts])
    normal = normal_own @ to_axes.T
    point = (np.array([c.point for c in contacts]) - situation.centre) @ to_axes.T
    low, high = situation.extents
    step = situation.steps[0]
    length = max(float(np.linalg.norm(step)), 1e-9)
    way = step / length
    kind = np.array([KINDS.index(c.kind) for c in contacts])
    pushed = np.where(kind == KINDS.index(ContactKind.PUSH), situation.pushed_share(normal_own), 1.0)
    moved = situation.poses[situation.places, :3][:, None] + np.einsum("tij,kj->tki", situation.R_places, p)
    stretch = np.linalg.norm(moved - situation.shoulder, axis=2).T / situation.span
    above = (moved[0, :, 2] - situation.poses[0, 2]) - low[2]
    height = (np.array([c.point for c in contacts]) @ to_axes[2] - low[2]) / max(high[2] - low[2], 1e-6)
    across = point[:, 0] * way[1] - point[:, 1] * way[0]
    return np.column_stack(
        [
            hand[:, :, 2],
            approach,
            np.abs(hand[:, :, 1]),
            normal,
            SCALE * point,
            normal @ way,
            hand[:, :, 2] @ way,
            SCALE * across,
            pushed,
            stretch,
            SCALE * above,
            height,
            SCALE * np.array([c.opening for c in contacts]),
            np.eye(len(KINDS))[kind],
        ]
    ).reshape(K, OWN)


def _from_object(situation: PathSituation, p: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Distances (K, len(HAND)) of the points of the hand from the object itself, scaled."""
    at = p[:, None] + np.einsum("kij,qj->kqi", R, HAND)
    return SCALE * situation.own_boxes.distances(at.reshape(-1, 3), LIMIT).reshape(len(p), -1)


def _clearances(situation: PathSituation, contacts: Sequence[ContactPoint], p: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Distances (K, STOPS * PROBES) of the points of hand and tool from what stands around, scaled."""
    K = len(contacts)
    side = 0.5 * np.array([c.opening for c in contacts]) + 0.012
    fingers = np.zeros((K, FINGERS, 3))
    fingers[:, 0, 1], fingers[:, 1, 1] = side, -side
    tool = np.zeros((TOOL, 3)) if situation.attached is None else tool_points(situation.attached)
    own = np.concatenate(
        [np.broadcast_to(HAND, (K, *HAND.shape)), fingers, np.broadcast_to(tool, (K, TOOL, 3))], axis=1
    )
    at = p[:, None] + np.einsum("kij,kqj->kqi", R, own)
    ways = BACK * np.einsum("kij,kj->ki", R, np.array([c.approach for c in contacts]))
    index = (0, *range(PLACES))
    points = np.empty((K, STOPS, PROBES, 3))
    for stop, place in enumerate(index):
        local = at - ways[:, None] if stop == 0 else at
        points[:, stop] = local @ situation.R_places[place].T + situation.poses[situation.places[place], :3]
    return SCALE * situation.boxes.distances(points.reshape(-1, 3), LIMIT).reshape(K, -1)
