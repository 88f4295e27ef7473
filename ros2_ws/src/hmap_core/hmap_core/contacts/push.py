"""Pushes: closed fingers, or a held body, against a side of an object that slides on its support."""

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np

from hmap_core.collision.convex import convex_set
from hmap_core.contacts import scoring
from hmap_core.contacts.access import on_face
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import CONTACT_GAP, Candidates, Hand, HandPoses, Situation, frames, on_surface
from hmap_core.contacts.facets import MIDDLE, held_facets, placed
from hmap_core.contacts.friction import characteristic_length, cone_generators, in_cone, needed_wrench, stable_pushes
from hmap_core.contacts.solids import Solids, solids
from hmap_core.transforms import IDENTITY, apply, inverse, multiply, rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint
from hmap_core.waypoints.support import centre_of_mass, feet

# a face this near to upright can be pushed, rad
UPRIGHT = float(np.deg2rad(10.0))
# lean of the fingers from pointing straight down towards pointing at the face, rad
LEANS = np.deg2rad([0.0, 30.0, 60.0, 90.0])
# turns of the hand about its approach: pads' faces or flanks against the object
ROLLS = np.deg2rad([0.0, 90.0, 180.0, 270.0])
# share of the object's friction coefficient that a push counts on
FRICTION_SHARE = 0.7
# what pushes and what is pushed overlap by this much in height, m
OVERLAP = 0.003
# fingers end at least this high over the support, m
MIN_HEIGHT = 0.01
# a motion that rises or tilts by more than this is not a slide
MAX_RISE = 1e-3  # m
MAX_TILT = float(np.deg2rad(1.0))
# ways to come to the face: how far down and to the side for each metre ahead, and what that costs in score
FINGER_WAYS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.05))
HELD_WAYS = (*FINGER_WAYS, (0.0, 1.0, 0.05), (0.0, -1.0, 0.05))
# what is held, where its height is free, is this far over the support, m
HELD_GAP = 0.005
# points that are tried with one facet of what is held, and of those in the middle of the face
PER_FACET, HEIGHTS = 16, 8
# of forces, as shares of the largest
ROUNDING = 1e-9
# steps by which a contact line is shortened to end on the face
SHRINKING = np.linspace(1.0, 0.0, 11)
# this much of a contact line is not counted on at each end, m: the object creeps along it, the pressure is uneven;
# at most this share of half the line
EDGE, EDGE_SHARE = 0.002, 0.4
# of so many points of a face one is also moved to where the push is balanced
BALANCED = 4
# a push is the steadier, the more of these it does without at the ends of its line, m, with this share of the friction
STEADY, STEADY_SHARE = (0.004, 0.008, 0.012), 0.5
# vertices this near to the pushed plane touch it, m
TOUCHING = 4 * CONTACT_GAP
# motions that differ by less than this share of their size are one
SAME_TWIST = 1e-3


def slide_twists(T0: np.ndarray, T1: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Twists (2, 3) vx, vy, w of the object's ``centre`` (3,) at both ends of a slide, in level axes fixed to it.

    The level axes are those of the world while the object is at T0. None when T1 is not reached from T0 on a plane.
    """
    turn = multiply(np.r_[np.zeros(3), T1[3:]], inverse(np.r_[np.zeros(3), T0[3:]]))[3:]
    turn = turn if turn[3] >= 0.0 else -turn
    angle = 2.0 * np.arctan2(turn[2], turn[3])
    tilt = 2.0 * np.arcsin(min(1.0, float(np.hypot(turn[0], turn[1]))))
    step = T1[:3] - T0[:3]
    if abs(step[2]) > MAX_RISE or tilt > MAX_TILT:
        return None
    arm = rotation_matrix(T0) @ centre
    spin = angle * np.array([-arm[1], arm[0]])
    c, s = np.cos(angle), np.sin(angle)
    last = np.array([c * step[0] + s * step[1], -s * step[0] + c * step[1]])
    return np.array([[*(step[:2] + spin), angle], [*(last + spin), angle]])


def _oriented(n: int, normals: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Frames (n * K, 3, 3) for every lean and roll."""
    lean = np.tile(np.repeat(LEANS, len(ROLLS)), n)
    roll = np.tile(ROLLS, n * len(LEANS))
    count = len(LEANS) * len(ROLLS)
    inward = -(normals - np.outer(normals @ up, up))
    inward = np.repeat(inward / np.linalg.norm(inward, axis=1)[:, None], count, axis=0)
    z = -np.cos(lean)[:, None] * up + np.sin(lean)[:, None] * inward
    tangent = np.cross(up, inward)
    x = np.cos(roll)[:, None] * tangent + np.sin(roll)[:, None] * np.cross(z, tangent)
    return frames(z, x)


class Slide:
    """An object that slides on its support.

    Args:
        body: the object.
        T_world_obj: (7,) where it stands.

    Attributes:
        level: (3, 3) from the object's frame to level axes, those of the world at T_world_obj.
        up: (3,) in the object's frame.
        footprint: polygons (n, 2) on which it stands, level axes; empty when it does not stand on a face.
        lowest, top: m, height of the support, and of the object's top, over the object's origin.
        centre, middle: (3,), (2,) centre of mass, in the object's frame and on the ground.
    """

    def __init__(self, body: Body, T_world_obj: np.ndarray):
        shapes = convex_set(body.shapes)
        self.body = body
        self.level = rotation_matrix(T_world_obj)
        self.up = self.level[2]
        self.footprint, self.lowest = feet(shapes, self.level)
        self.top = float(max((shapes.hull(k) @ self.up).max() + shapes.radius[k] for k in range(len(shapes))))
        self.centre = centre_of_mass(shapes)
        self.middle = (self.level @ self.centre)[:2]
        self.own = solids([(shape, IDENTITY) for shape in body.shapes])

    @cached_property
    def length(self) -> float:
        """Characteristic length under even pressure, m."""
        return characteristic_length(self.footprint, self.middle)

    @cached_property
    def rim_length(self) -> float:
        """Characteristic length of a body that rests on the corners of its footprint, as most do, m."""
        return float(np.linalg.norm(np.concatenate(self.footprint) - self.middle, axis=1).mean())

    @cached_property
    def likely_length(self) -> float:
        """Characteristic length in the middle of both, as nobody knows where the object's weight rests, m."""
        return float(np.sqrt(0.5 * (self.length**2 + self.rim_length**2)))

    def lines(self, points, normals, R, origin, feature, tip) -> tuple[np.ndarray, np.ndarray]:
        """Lines of contact: ends (N, 2, 2) about the middle and normals (N, 2) in level axes.

        The vertices ``tip`` (V, 3) of the pusher that are ``feature`` (N, V) lie against the face at ``points``.
        """
        flat = _leveled(normals, self.level)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        sideways = np.stack([flat[:, 1], -flat[:, 0], np.zeros(len(flat))], axis=1) @ self.level
        ends = _contact_lines(points, normals, sideways, R, origin, feature, tip, self.own)
        return np.stack([_leveled(e, self.level) for e in ends], axis=1) - self.middle, flat

    def behind(self, normals: np.ndarray, twists: np.ndarray, friction: float) -> np.ndarray:
        """Which sides (N,) can push at all: for all twists (T, 3), the needed force is in their friction cone.

        All forces of a line contact are in that cone of its side, whatever their moment.
        """
        flat = _leveled(normals, self.level)
        ahead, across = flat @ -twists[:, :2].T, np.abs(flat[:, ::-1] @ (twists[:, :2] * [1.0, -1.0]).T)
        return np.all((ahead > 0.0) & (across <= friction * ahead + ROUNDING), axis=1)

    def balanced(self, cloud: Cloud, twists: np.ndarray) -> Cloud:
        """Points of upright faces moved along them, level, to where the force that the twists (T, 3) need passes.

        Those for which that is beyond their face stop before its edge.
        """
        flat = _leveled(cloud.normals, self.level)
        along = np.stack([flat[:, 1], -flat[:, 0]], axis=1) / np.linalg.norm(flat, axis=1)[:, None]
        places = _leveled(cloud.points, self.level) - self.middle
        way = _level_with(places, along, needed_wrench(twists, self.likely_length).mean(axis=0))
        offset = np.where(np.isfinite(way), way, 0.0)[:, None] * np.c_[along, np.zeros(len(along))] @ self.level
        share = on_face(cloud.points, cloud.normals, offset, SHRINKING, *self.own.arrays)
        return Cloud(cloud.points + share[:, None] * offset, cloud.normals, cloud.seen)

    def twists(self, poses: np.ndarray) -> Iterator[np.ndarray | None]:
        """Twists (2, 3) vx, vy, w of each step between poses (M, 7), in level axes on the object; None: no slide."""
        for T0, T1 in zip(poses, poses[1:], strict=False):
            twists = slide_twists(T0, T1, self.centre)
            if twists is not None:
                turn = self.level @ rotation_matrix(T0).T
                if abs(turn[2, 2]) < np.cos(MAX_TILT):
                    twists = None
                else:
                    twists = np.column_stack([twists[:, :2] @ turn[:2, :2].T, twists[:, 2]])
            yield twists


def pushes(
    body: Body,
    cloud: Cloud,
    own: Solids,
    centre: np.ndarray,
    radius: float,
    hand: Hand,
    situation: Situation,
    rng: np.random.Generator,
) -> Candidates | None:
    """Pushes that carry the object to its next pose, sticking and without toppling it; None when it does not slide.

    The line of contact is the part of the closed fingertips, or of a facet of the held body, that lies on the face.
    """
    if situation.T_world_next is None:
        return None
    slide = Slide(body, situation.T_world_obj)
    twists = slide_twists(situation.T_world_obj, situation.T_world_next, slide.centre)
    if twists is None or not slide.footprint:
        return None
    friction = hand.friction(body.friction)
    sideways = np.abs(cloud.normals @ slide.up) <= np.sin(UPRIGHT)
    cloud = cloud[sideways & (cloud.points @ slide.up >= slide.lowest + MIN_HEIGHT)]
    cloud = cloud[slide.behind(cloud.normals, twists, FRICTION_SHARE * friction)]
    if not len(cloud):
        return None
    sets = (
        _held_poses(slide, cloud, twists, hand, rng)
        if hand.attached
        else [_finger_poses(slide, cloud, twists, hand.tip)]
    )
    found = []
    for points, R, origin, feature, tip, upright, index in sets:
        normals = cloud.normals[index]
        ends, flat = slide.lines(points, normals, R, origin, feature, tip)
        keep = stable_pushes(_shortened(ends, EDGE, EDGE_SHARE), flat, FRICTION_SHARE * friction, twists, slide.length)
        steady = np.mean(
            [
                stable_pushes(_shortened(ends, e, 1.0), flat, STEADY_SHARE * friction, twists, slide.length)
                for e in STEADY
            ],
            axis=0,
        )
        keep &= _overlaps(slide, R, origin, feature, tip)
        keep &= _stays_upright(points @ slide.up - slide.lowest, flat, slide.footprint, slide.middle, friction)
        score = (
            scoring.place(points, normals, cloud.seen[index], centre, radius, situation)
            + scoring.W_ABOVE * scoring.above(R[:, :, 2], situation.T_world_obj)
            + scoring.W_UPRIGHT * upright
            + scoring.W_STEADY * steady
        )
        sideways = np.cross(normals, slide.up)
        for down, aside, price in HELD_WAYS if hand.attached else FINGER_WAYS:
            way = -normals - down * slide.up + aside * sideways
            approach = np.einsum("nij,ni->nj", R, way / np.linalg.norm(way, axis=1)[:, None])
            arrays = (R, origin, np.full(len(points), hand.closed), approach, points, normals, score - price)
            found.append([a[keep] for a in arrays])
    *made, points, normals, score = (np.concatenate(a) for a in zip(*found, strict=True))
    poses = HandPoses(*made)
    return Candidates(ContactKind.PUSH, poses.R[:, :, 2], points, normals, score, poses.__getitem__)


def _overlaps(slide: Slide, R: np.ndarray, origin: np.ndarray, feature: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Whether (N,) what touches begins by OVERLAP below the object's top, and does not end below its bottom."""
    height = np.einsum("i,nij,vj->nv", slide.up, R, tip) + (origin @ slide.up)[:, None]
    low, high = (f(np.where(feature, height, e), axis=1) for f, e in ((np.min, np.inf), (np.max, -np.inf)))
    return (slide.top - low >= OVERLAP) & (high >= slide.lowest + OVERLAP)


def _finger_poses(slide: Slide, cloud: Cloud, twists: np.ndarray, tip: np.ndarray):
    """Closed fingers at the points, and at some of them moved to where the push is balanced."""
    own = np.r_[np.arange(len(cloud)), np.arange(len(cloud))[::BALANCED]]
    points = np.concatenate([cloud.points, slide.balanced(cloud[::BALANCED], twists).points])
    R = _oriented(len(own), cloud.normals[own], slide.up)
    turns = len(R) // len(own)
    points, index = np.repeat(points, turns, axis=0), np.repeat(own, turns)
    origin, feature = on_surface(R, points, cloud.normals[index], tip)
    return points, R, origin, feature, tip, np.zeros(len(R)), index


def _held_poses(slide: Slide, cloud: Cloud, twists: np.ndarray, hand: Hand, rng: np.random.Generator):
    """For each facet of what is held, the poses in which it lies against the points; and those moved to balance.

    At the latter the middle of the facet lies where the force passes, as far as the face allows, and nothing of what is
    held is nearer to the support than HELD_GAP.
    """
    own_up = rotation_matrix(hand.attached.T_ee_body) @ hand.attached.up
    even = slide.balanced(cloud, twists)
    for facet in held_facets(hand.attached):
        for own, share, count in ((cloud, MIDDLE, PER_FACET), (even, 1.0, HEIGHTS)):
            R, origin, upright, index = placed(facet, own_up, own.points, own.normals, slide.up, rng, share, count)
            points = own.points[index]
            if own is even:
                lowest = (np.einsum("i,nij,vj->nv", slide.up, R, hand.tip) + (origin @ slide.up)[:, None]).min(axis=1)
                lift = np.maximum(0.0, slide.lowest + HELD_GAP - lowest)[:, None] * slide.up
                points, origin = points + lift, origin + lift
            feature = np.ones((len(R), len(facet.vertices)), bool)
            yield points, R, origin, feature, facet.vertices, upright, index


def push_reach(body: Body, hand: Hand, contacts: Sequence[ContactPoint], poses: np.ndarray) -> np.ndarray:
    """How far (K,) pushes carry the object along poses (M, 7) without slipping: index of a pose.

    The line of contact is found anew from where the pusher is, so that contacts of any origin can be asked about.
    """
    last = np.full(len(contacts), len(poses) - 1)
    own = np.array([k for k, c in enumerate(contacts) if c.kind == ContactKind.PUSH], int)
    if not len(own):
        return last
    slide = Slide(body, poses[0])
    if not slide.footprint:
        last[own] = 0
        return last
    pushing = [contacts[k] for k in own]
    at = np.array([c.T_obj_ee for c in pushing])
    R = np.array([rotation_matrix(T) for T in at])
    points, normals = np.array([c.point for c in pushing]), np.array([c.normal for c in pushing])
    corners = np.array([apply(T, hand.tip) for T in at])
    off = np.abs(np.einsum("nvi,ni->nv", corners - points[:, None], normals))
    feature = off <= np.maximum(off.min(axis=1, keepdims=True), TOUCHING)  # of a round end the nearest vertex
    ends, flat = slide.lines(points, normals, R, at[:, :3], feature, hand.tip)
    generators = cone_generators(
        _shortened(ends, EDGE, EDGE_SHARE), flat, FRICTION_SHARE * hand.friction(body.friction)
    )
    holds, before = np.ones(len(own), bool), None
    for k, twists in enumerate(slide.twists(poses)):
        if twists is None:
            holds[:] = False
        else:
            for twist in twists:
                wrench = needed_wrench(twist, slide.length)
                size = np.linalg.norm(wrench)
                if size == 0.0:
                    continue
                wrench /= size
                if before is None or np.abs(wrench - before).max() > SAME_TWIST:
                    holds &= in_cone(generators, wrench)
                    before = wrench
        last[own[~holds & (last[own] > k)]] = k
        if not holds.any():
            break
    return last


def _level_with(places: np.ndarray, along: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """How far (N,) along (N, 2) from places (N, 2) a wrench (fx, fy, m) acts as a force; not finite: nowhere."""
    fx, fy, m = wrench
    with np.errstate(divide="ignore", invalid="ignore"):
        return (m - places[:, 0] * fy + places[:, 1] * fx) / (along[:, 0] * fy - along[:, 1] * fx)


def _leveled(vectors: np.ndarray, level: np.ndarray) -> np.ndarray:
    return (vectors @ level.T)[:, :2]


def _contact_lines(points, normals, tangent, R, origin, feature, tip, own) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (N, 3) of the line in which the fingertips lie against the face, cut off where the face ends."""
    reach = np.einsum("nij,ni->nj", R, tangent) @ tip.T + np.einsum("ni,ni->n", origin - points, tangent)[:, None]
    high = np.where(feature, reach, -np.inf).max(axis=1)
    low = np.where(feature, reach, np.inf).min(axis=1)
    ends = []
    for side in (low, high):
        offset = tangent * side[:, None]
        ends.append(points + offset * on_face(points, normals, offset, SHRINKING, *own.arrays)[:, None])
    return ends[0], ends[1]


def _shortened(ends: np.ndarray, edge: float, most: float) -> np.ndarray:
    """Lines (N, 2, 2) without ``edge`` metres at each end, or the share ``most`` of their halves if that is less."""
    middle = ends.mean(axis=1, keepdims=True)
    half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2.0
    cut = edge / np.maximum(half, edge / most)
    return middle + (1.0 - cut)[:, None, None] * (ends - middle)


def _stays_upright(height, flat, footprint, middle, friction) -> np.ndarray:
    """Whether (N,) the object pushed at ``height`` (N,) m slides rather than topples over its leading edge."""
    corners = np.concatenate(footprint) - middle
    lead = (-flat @ corners.T).max(axis=1)
    return friction * height <= lead
