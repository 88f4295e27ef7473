"""Pushes: closed fingers, or an attached body, against a side of an object that slides on its support.

The push is a line contact that sticks (stable push: Lynch & Mason, "Stable pushing", IJRR 1996).
"""

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import convex_set
from hmap_core.contacts import scoring
from hmap_core.contacts.access import on_face
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import CONTACT_GAP, Candidates, Hand, HandPoses, Situation, frames, on_surface
from hmap_core.contacts.facets import MIDDLE, attached_facets, facet_poses
from hmap_core.contacts.friction import characteristic_length, cone_generators, in_cone, needed_wrench, stable_pushes
from hmap_core.contacts.solids import Solids, solids
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, apply, inverse, multiply, rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint
from hmap_core.waypoints.support import feet

# largest angle of a pushed face to the vertical, rad
UPRIGHT = float(np.deg2rad(10.0))
# angle of the fingers between pointing straight down and pointing at the face, rad
LEANS = np.deg2rad([0.0, 15.0, 30.0, 60.0, 90.0])
# rotations of the hand about its approach: faces or sides of the pads against the object
ROLLS = np.deg2rad([0.0, 90.0, 180.0, 270.0])
# sides of a hand that turns about the vertical only, the widest ones
SIDES = 8
# share of the object's friction coefficient that a push relies on
FRICTION_SHARE = 0.7
# smallest overlap of pusher and object in height, m
OVERLAP = 0.003
# lowest height of the fingertips above the support, m
MIN_HEIGHT = 0.01
# a motion that rises or tilts by more than this is not a slide
MAX_RISE = 1e-3  # m
MAX_TILT = float(np.deg2rad(1.0))
# approach directions: metres down and to the side for each metre ahead, and their cost in score
FINGER_APPROACHES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.05))
# of a hand that leans, too: it comes almost along itself where something stands behind the object
STEEP_APPROACH, STEEP_LEANS = (2.0, 0.0, 0.05), np.deg2rad([5.0, 45.0])
ATTACHED_APPROACHES = (*FINGER_APPROACHES, (0.0, 1.0, 0.05), (0.0, -1.0, 0.05))
# height of an attached body above the support, if its height is free, m
ATTACHED_CLEARANCE = 0.005
# points that are tried with each facet of an attached body, and of those moved to balance the push
PER_FACET, HEIGHTS = 16, 8
# relative rounding error of forces
ROUNDING = 1e-9
# factors by which a contact line is shortened to end on the face
SHRINKING = np.linspace(1.0, 0.0, 11)
# part of a contact line that is not relied on at each end, m, because the object creeps along the line and the
# pressure is uneven; at most this share of half the line
EDGE, EDGE_SHARE = 0.002, 0.4
# every n-th point of a face is also moved to where the push is balanced
BALANCED_EVERY = 4
# a push is more robust if it is stable without these parts of its line's ends, m, and with this share of friction
ROBUST_EDGES, ROBUST_SHARE = (0.004, 0.008, 0.012), 0.5
# vertices that are nearer to the pushed plane touch it, m
TOUCHING = 4 * CONTACT_GAP
# motions with a smaller relative difference are the same
SAME_TWIST = 1e-3


def slide_twists(T0: np.ndarray, T1: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Twists of a planar motion.

    Args:
        T0: T_world_obj (7,) at the start.
        T1: T_world_obj (7,) at the end.
        centre: (3,) the object's centre of mass, object frame.

    Returns:
        Twists (2, 3) vx, vy, w of the centre at start and end, in level axes fixed to the object; these are the world's
        axes while the object is at T0. None if no planar motion leads from T0 to T1.
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
    """Frames (n * K, 3, 3) for all K angles and rotations of the hand."""
    lean = np.tile(np.repeat(LEANS, len(ROLLS)), n)
    roll = np.tile(ROLLS, n * len(LEANS))
    count = len(LEANS) * len(ROLLS)
    inward = -(normals - np.outer(normals @ up, up))
    inward = np.repeat(inward / np.linalg.norm(inward, axis=1)[:, None], count, axis=0)
    z = -np.cos(lean)[:, None] * up + np.sin(lean)[:, None] * inward
    tangent = np.cross(up, inward)
    x = np.cos(roll)[:, None] * tangent + np.sin(roll)[:, None] * np.cross(z, tangent)
    return frames(z, x)


class SlidingBody:
    """An object that slides on its support.

    Args:
        body: the object.
        T_world_obj: (7,) its pose.

    Attributes:
        level: (3, 3) rotation from the object's frame to level axes, which are the world's axes at T_world_obj.
        up: (3,) vertical direction in the object's frame.
        footprint: polygons (n, 2) on which it stands, level axes; empty if it does not stand on a face.
        lowest: height of the support above the object's origin, m.
        top: height of the object's top above its origin, m.
        centre: (3,) centre of mass, object frame, m.
        middle: (2,) centre of mass on the ground, level axes, m.
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
        """Characteristic length in m for uniform pressure."""
        return characteristic_length(self.footprint, self.middle)

    @cached_property
    def rim_length(self) -> float:
        """Characteristic length in m of a body that rests on its footprint's corners, as most do."""
        return float(np.linalg.norm(np.concatenate(self.footprint) - self.middle, axis=1).mean())

    @cached_property
    def likely_length(self) -> float:
        """Characteristic length in m between both, because the true pressure distribution is unknown."""
        return float(np.sqrt(0.5 * (self.length**2 + self.rim_length**2)))

    def lines(self, points, normals, R, origin, feature, tip) -> tuple[np.ndarray, np.ndarray]:
        """Contact lines of a pusher on faces of the object.

        Args:
            points: (N, 3) contact points, object frame, m.
            normals: (N, 3) outward unit normals there.
            R: (N, 3, 3) orientation of the end-effector frame.
            origin: (N, 3) its position, m.
            feature: (N, V) which vertices of the pusher touch the face.
            tip: (V, 3) the pusher's vertices, end-effector frame, m.

        Returns:
            Ends (N, 2, 2) of the lines relative to the middle, and normals (N, 2), in level axes.
        """
        flat = _to_plane(normals, self.level)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        sideways = np.stack([flat[:, 1], -flat[:, 0], np.zeros(len(flat))], axis=1) @ self.level
        ends = _contact_lines(points, normals, sideways, R, origin, feature, tip, self.own)
        return np.stack([_to_plane(e, self.level) for e in ends], axis=1) - self.middle, flat

    def behind(self, normals: np.ndarray, twists: np.ndarray, friction: float) -> np.ndarray:
        """Which sides (N,) can push: their friction cones contain the needed force for all twists (T, 3).

        All forces of a line contact are in the friction cone of its side, whatever their moment.
        """
        flat = _to_plane(normals, self.level)
        ahead, across = flat @ -twists[:, :2].T, np.abs(flat[:, ::-1] @ (twists[:, :2] * [1.0, -1.0]).T)
        return np.all((ahead > 0.0) & (across <= friction * ahead + ROUNDING), axis=1)

    def balanced(self, cloud: Cloud, twists: np.ndarray) -> Cloud:
        """Move points of upright faces horizontally along the face to the line of action of the needed force.

        A point whose line of action is beyond its face stops before the edge.

        Args:
            cloud: points on upright faces, object frame.
            twists: (T, 3) of the motion, level axes.

        Returns:
            The moved points.
        """
        flat = _to_plane(cloud.normals, self.level)
        along = np.stack([flat[:, 1], -flat[:, 0]], axis=1) / np.linalg.norm(flat, axis=1)[:, None]
        places = _to_plane(cloud.points, self.level) - self.middle
        way = _line_of_action(places, along, needed_wrench(twists, self.likely_length).mean(axis=0))
        offset = np.where(np.isfinite(way), way, 0.0)[:, None] * np.c_[along, np.zeros(len(along))] @ self.level
        share = on_face(cloud.points, cloud.normals, offset, SHRINKING, *self.own.arrays)
        return Cloud(cloud.points + share[:, None] * offset, cloud.normals, cloud.seen)

    def twists(self, poses: np.ndarray) -> Iterator[np.ndarray | None]:
        """Twists (2, 3) vx, vy, w of each step between poses (M, 7), in level axes fixed to the object.

        None for a step that is no planar motion.
        """
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
    """Stable pushes that move the object to its next pose without toppling it.

    The contact line is the part of the closed fingertips, or of a facet of the attached body, that is on the face.

    Args:
        body: the object.
        cloud: surface points, object frame.
        own: the object's shapes.
        centre: (3,) its centre of mass, object frame, m.
        radius: its radius about the centre, m.
        hand: the fingers, or the attached body.
        situation: the object's pose and next pose, and the robot's position.
        rng: the only source of randomness.

    Returns:
        The pushes; None if the motion is not planar or the object does not stand on a face.
    """
    if situation.T_world_next is None:
        return None
    slide = SlidingBody(body, situation.T_world_obj)
    twists = slide_twists(situation.T_world_obj, situation.T_world_next, slide.centre)
    if twists is None or not slide.footprint:
        return None
    friction = hand.friction(body.friction)
    sliding = min(body.friction, np.inf if situation.support_friction is None else situation.support_friction)
    sideways = np.abs(cloud.normals @ slide.up) <= np.sin(UPRIGHT)
    cloud = cloud[sideways & (cloud.points @ slide.up >= slide.lowest + MIN_HEIGHT)]
    cloud = cloud[slide.behind(cloud.normals, twists, FRICTION_SHARE * friction)]
    if not len(cloud):
        return None
    sets = (
        _attached_poses(slide, cloud, twists, hand, rng)
        if hand.attached
        else [_finger_poses(slide, cloud, twists, hand)]
    )
    sides = _sides(hand.tip, situation.R_world_hand)
    if situation.R_world_hand is not None and len(sides):
        sets = [*sets, _side_poses(slide, cloud, twists, hand, situation.R_world_hand, sides)]
    found = []
    for points, R, origin, feature, tip, upright, index in sets:
        normals = cloud.normals[index]
        ends, flat = slide.lines(points, normals, R, origin, feature, tip)
        keep = stable_pushes(_shortened(ends, EDGE, EDGE_SHARE), flat, FRICTION_SHARE * friction, twists, slide.length)
        robust = np.mean(
            [
                stable_pushes(_shortened(ends, e, 1.0), flat, ROBUST_SHARE * friction, twists, slide.length)
                for e in ROBUST_EDGES
            ],
            axis=0,
        )
        keep &= _overlaps(slide, R, origin, feature, tip)
        keep &= _stays_upright(points @ slide.up - slide.lowest, flat, slide.footprint, slide.middle, sliding)
        score = (
            scoring.position_score(points, normals, cloud.seen[index], centre, radius, situation)
            + scoring.W_ABOVE * scoring.above(R[:, :, 2], situation.T_world_obj)
            + scoring.W_UPRIGHT * upright
            + scoring.W_ROBUST * robust
        )
        sideways = np.cross(normals, slide.up)
        for (down, aside, price), serves in _approaches(hand, R, slide.up):
            way = -normals - down * slide.up + aside * sideways
            approach = np.einsum("nij,ni->nj", R, way / np.linalg.norm(way, axis=1)[:, None])
            arrays = (R, origin, np.full(len(points), hand.closed), approach, points, normals, score - price)
            found.append([a[keep & serves] for a in arrays])
    *made, points, normals, score = (np.concatenate(a) for a in zip(*found, strict=True))
    poses = HandPoses(*made)
    return Candidates(ContactKind.PUSH, poses.R[:, :, 2], points, normals, score, poses.__getitem__)


def _approaches(hand: Hand, R: np.ndarray, up: np.ndarray) -> Iterator[tuple[tuple[float, float, float], np.ndarray]]:
    """The approaches of a hand or an attached body, each with the orientations (N, 3, 3) that it is for, (N,) bool."""
    for approach in ATTACHED_APPROACHES if hand.attached else FINGER_APPROACHES:
        yield approach, np.ones(len(R), bool)
    if hand.attached is None:
        steepness = -R[:, :, 2] @ up
        yield STEEP_APPROACH, (steepness <= np.cos(STEEP_LEANS[0])) & (steepness >= np.cos(STEEP_LEANS[1]))


def _overlaps(
    slide: SlidingBody, R: np.ndarray, origin: np.ndarray, feature: np.ndarray, tip: np.ndarray
) -> np.ndarray:
    """Whether (N,) pusher and object overlap in height by OVERLAP."""
    height = np.einsum("i,nij,vj->nv", slide.up, R, tip) + (origin @ slide.up)[:, None]
    low, high = (f(np.where(feature, height, e), axis=1) for f, e in ((np.min, np.inf), (np.max, -np.inf)))
    return (slide.top - low >= OVERLAP) & (high >= slide.lowest + OVERLAP)


def _finger_poses(slide: SlidingBody, cloud: Cloud, twists: np.ndarray, hand: Hand):
    """Closed fingers at the points, and at every n-th point moved to balance the push."""
    points, own = _places(slide, cloud, twists)
    R = _oriented(len(own), cloud.normals[own], slide.up)
    turns = len(R) // len(own)
    points, index = np.repeat(points, turns, axis=0), np.repeat(own, turns)
    origin, feature = on_surface(R, points, cloud.normals[index], hand.tip, hand.tip_radius)
    return points, R, origin, feature, hand.tip, np.zeros(len(R)), index


def _side_poses(
    slide: SlidingBody, cloud: Cloud, twists: np.ndarray, hand: Hand, R_world_hand: np.ndarray, sides: np.ndarray
):
    """As :func:`_finger_poses`, with the sides of a hand that turns about the vertical only; its lower end touches."""
    points, own = _places(slide, cloud, twists)
    turns = len(sides)
    points, index = np.repeat(points, turns, axis=0), np.repeat(own, turns)
    inward = -_to_plane(cloud.normals[index], slide.level)
    angle = np.arctan2(inward[:, 1], inward[:, 0]) - np.tile(sides, len(own))
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 2, 2] = np.sin(angle), 1.0
    turn[:, 0, 1] = -turn[:, 1, 0]
    R = slide.level.T @ turn @ R_world_hand
    origin, feature = on_surface(R, points, cloud.normals[index], hand.tip, hand.tip_radius, end=-slide.up)
    return points, R, origin, feature, hand.tip, np.zeros(len(R)), index


def _places(slide: SlidingBody, cloud: Cloud, twists: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points, and every n-th of them moved to balance the push, (N, 3); and indices (N,) of their normals."""
    own = np.r_[np.arange(len(cloud)), np.arange(len(cloud))[::BALANCED_EVERY]]
    return np.concatenate([cloud.points, slide.balanced(cloud[::BALANCED_EVERY], twists).points]), own


def _sides(tip: np.ndarray, R_world_hand: np.ndarray | None) -> np.ndarray:
    """Directions (S,) of the widest upright sides of a hand with vertices ``tip`` (V, 3), rad about the vertical.

    At most SIDES; none without an orientation of the hand.
    """
    if R_world_hand is None:
        return np.zeros(0)
    flat = (tip @ R_world_hand.T)[:, :2]
    flat = flat - flat.mean(axis=0)
    if np.linalg.svd(flat, compute_uv=False).min(initial=np.inf) < TOUCHING or len(flat) < 3:
        return np.zeros(0)
    hull = ConvexHull(flat)
    width = np.linalg.norm(np.diff(flat[hull.simplices], axis=1)[:, 0], axis=1)
    widest = hull.equations[np.argsort(-width, kind="stable")[:SIDES]]
    return np.arctan2(widest[:, 1], widest[:, 0])


def _attached_poses(slide: SlidingBody, cloud: Cloud, twists: np.ndarray, hand: Hand, rng: np.random.Generator):
    """For each facet of the attached body, its poses against the points, and against points moved to balance the push.

    At the moved points the facet's middle is on the force's line of action, as far as the face allows, and no part of
    the attached body is nearer to the support than ATTACHED_CLEARANCE.
    """
    attached = hand.require_attached()
    own_up = rotation_matrix(attached.T_ee_body) @ attached.up
    even = slide.balanced(cloud, twists)
    for facet in attached_facets(attached):
        for own, share, count in ((cloud, MIDDLE, PER_FACET), (even, 1.0, HEIGHTS)):
            R, origin, upright, index = facet_poses(facet, own_up, own.points, own.normals, slide.up, rng, share, count)
            points = own.points[index]
            if own is even:
                lowest = (np.einsum("i,nij,vj->nv", slide.up, R, hand.tip) + (origin @ slide.up)[:, None]).min(axis=1)
                lift = np.maximum(0.0, slide.lowest + ATTACHED_CLEARANCE - lowest)[:, None] * slide.up
                points, origin = points + lift, origin + lift
            feature = np.ones((len(R), len(facet.vertices)), bool)
            yield points, R, origin, feature, facet.vertices, upright, index


def push_reach(body: Body, hand: Hand, contacts: Sequence[ContactPoint], poses: np.ndarray) -> np.ndarray:
    """How far pushes move the object along a path without slipping.

    The contact line is computed from the pusher's pose, so the contacts can have any source.

    Args:
        body: the object.
        hand: the fingers, or the attached body.
        contacts: K contacts on the object.
        poses: (M, 7) T_world_obj.

    Returns:
        (K,) index of the last pose that each push reaches; M - 1 for contacts that are no pushes.
    """
    last = np.full(len(contacts), len(poses) - 1)
    own = np.array([k for k, c in enumerate(contacts) if c.kind == ContactKind.PUSH], int)
    if not len(own):
        return last
    slide = SlidingBody(body, poses[0])
    if not slide.footprint:
        last[own] = 0
        return last
    pushing = [contacts[k] for k in own]
    at = np.array([c.T_obj_ee for c in pushing])
    R = np.array([rotation_matrix(T) for T in at])
    points, normals = np.array([c.point for c in pushing]), np.array([c.normal for c in pushing])
    corners = np.array([apply(T, hand.tip) for T in at])
    off = np.abs(np.einsum("nvi,ni->nv", corners - points[:, None], normals))
    feature = off <= np.maximum(off.min(axis=1, keepdims=True), TOUCHING)  # for a round tip the nearest vertex
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


def _line_of_action(places: np.ndarray, along: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Distance (N,) along directions (N, 2) from points (N, 2) to a wrench's line of action; not finite: parallel."""
    fx, fy, m = wrench
    with np.errstate(divide="ignore", invalid="ignore"):
        return (m - places[:, 0] * fy + places[:, 1] * fx) / (along[:, 0] * fy - along[:, 1] * fx)


def _to_plane(vectors: np.ndarray, level: np.ndarray) -> np.ndarray:
    return (vectors @ level.T)[:, :2]


def _contact_lines(points, normals, tangent, R, origin, feature, tip, own) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (N, 3) of the lines where the fingertips touch the face; lines end at the face's edge."""
    reach = np.einsum("nij,ni->nj", R, tangent) @ tip.T + np.einsum("ni,ni->n", origin - points, tangent)[:, None]
    high = np.where(feature, reach, -np.inf).max(axis=1)
    low = np.where(feature, reach, np.inf).min(axis=1)
    ends = []
    for side in (low, high):
        offset = tangent * side[:, None]
        ends.append(points + offset * on_face(points, normals, offset, SHRINKING, *own.arrays)[:, None])
    return ends[0], ends[1]


def _shortened(ends: np.ndarray, edge: float, most: float) -> np.ndarray:
    """Lines (N, 2, 2) without ``edge`` metres at each end, or the share ``most`` of their halves if less."""
    middle = ends.mean(axis=1, keepdims=True)
    half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2.0
    cut = edge / np.maximum(half, edge / most)
    return middle + (1.0 - cut)[:, None, None] * (ends - middle)


def _stays_upright(height, flat, footprint, middle, friction) -> np.ndarray:
    """Whether (N,) the object slides rather than topples over its leading edge when pushed at ``height`` (N,) m.

    ``friction`` is the coefficient with its support.
    """
    corners = np.concatenate(footprint) - middle
    lead = (-flat @ corners.T).max(axis=1)
    return friction * height <= lead
