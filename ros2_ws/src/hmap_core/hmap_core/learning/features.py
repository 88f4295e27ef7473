"""The numbers from which the model scores one contact. They do not change where the whole scene is moved or turned."""

from collections.abc import Sequence

import numpy as np

from hmap_core.learning.clearance import probe_distances
from hmap_core.learning.situation import PLACES, PathSituation, tool_points
from hmap_core.transforms import rotation_matrices
from hmap_core.types import ContactKind, ContactPoint

LIMIT = 0.12  # m: distances beyond it do not matter
SCALE = 10.0  # per m, of lengths
KINDS = (ContactKind.TOUCH, ContactKind.GRASP, ContactKind.PUSH, ContactKind.PRESS)
NUMBERS = {kind: number for number, kind in enumerate(KINDS)}
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
SIDE = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])  # of each finger
CLOSED = np.concatenate([HAND, 0.012 * SIDE, np.zeros((TOOL, 3))])  # points (PROBES, 3) of a closed hand, m
WIDENING = np.concatenate([np.zeros_like(HAND), 0.5 * SIDE, np.zeros((TOOL, 3))])  # of them, by the opening
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
    found = np.empty((len(contacts), WIDTH), np.float32)
    if not contacts:
        return found
    given = _Given(contacts)
    found[:, :COMMON] = situation.common
    _own(situation, given, found[:, COMMON : COMMON + OWN])
    _from_object(situation, given, found, COMMON + OWN)
    _clearances(situation, given, found, COMMON + OWN + len(HAND))
    return found


class _Given:
    """K contacts as arrays: frames, points, normals and approaches of the hands, openings, kinds."""

    def __init__(self, contacts: Sequence[ContactPoint]):
        frames = np.array([contact.T_obj_ee for contact in contacts])
        self.origin, self.R = np.ascontiguousarray(frames[:, :3]), rotation_matrices(frames)
        self.point = np.array([contact.point for contact in contacts])
        self.normal = np.array([contact.normal for contact in contacts])
        self.approach = np.array([contact.approach for contact in contacts])
        self.opening = np.array([contact.opening for contact in contacts], float)
        self.kind = np.array([NUMBERS[contact.kind] for contact in contacts])


def _own(situation: PathSituation, given: _Given, out: np.ndarray) -> None:
    """Write numbers (K, OWN) of the contacts themselves."""
    to_axes = situation.axes @ situation.R_places[0]
    hand = to_axes @ given.R
    normal = given.normal @ to_axes.T
    point = (given.point - situation.centre) @ to_axes.T
    low, high = situation.extents
    step = situation.steps[0]
    way = step / max(float(np.linalg.norm(step)), 1e-9)
    moved = given.origin @ situation.R_places.swapaxes(1, 2) + situation.poses[situation.places, None, :3]
    out[:, 0:3] = hand[:, :, 2]
    out[:, 3:6] = (hand @ given.approach[:, :, None])[:, :, 0]
    out[:, 6:9] = np.abs(hand[:, :, 1])
    out[:, 9:12] = normal
    out[:, 12:15] = SCALE * point
    out[:, 15] = normal @ way
    out[:, 16] = hand[:, :, 2] @ way
    out[:, 17] = SCALE * (point[:, 0] * way[1] - point[:, 1] * way[0])
    pushed = given.kind == NUMBERS[ContactKind.PUSH]
    out[:, 18] = np.where(pushed, situation.pushed_share(given.normal), 1.0) if pushed.any() else 1.0
    out[:, 19 : 19 + PLACES] = np.linalg.norm(moved - situation.shoulder, axis=2).T / situation.span
    rest = out[:, 19 + PLACES :]
    rest[:, 0] = SCALE * (moved[0, :, 2] - situation.poses[0, 2] - low[2])
    rest[:, 1] = (given.point @ to_axes[2] - low[2]) / max(high[2] - low[2], 1e-6)
    rest[:, 2] = SCALE * given.opening
    rest[:, 3:] = np.eye(len(KINDS))[given.kind]


def _from_object(situation: PathSituation, given: _Given, out: np.ndarray, column: int) -> None:
    """Write distances (K, len(HAND)) of the points of the hand from the object itself, scaled."""
    boxes = situation.own_boxes
    probe_distances(
        given.R, given.origin, given.opening, HAND, np.zeros_like(HAND), given.approach,
        np.eye(3)[None], np.zeros((1, 3)), np.zeros(1), boxes.R, boxes.p, boxes.half, LIMIT, SCALE, out, column,
    )  # fmt: skip


def _clearances(situation: PathSituation, given: _Given, out: np.ndarray, column: int) -> None:
    """Write distances (K, STOPS * PROBES) of the points of hand and tool from what stands around, scaled."""
    probes = CLOSED
    if situation.attached is not None:
        probes = CLOSED.copy()
        probes[-TOOL:] = tool_points(situation.attached)
    ways = (given.R @ given.approach[:, :, None])[:, :, 0]
    stops = np.array([0, *range(PLACES)])
    back = np.array([BACK, *np.zeros(PLACES)])
    at, boxes = np.ascontiguousarray(situation.poses[situation.places[stops], :3]), situation.boxes
    probe_distances(
        given.R, given.origin, given.opening, probes, WIDENING, ways,
        situation.R_places[stops], at, back, boxes.R, boxes.p, boxes.half, LIMIT, SCALE, out, column,
    )  # fmt: skip
