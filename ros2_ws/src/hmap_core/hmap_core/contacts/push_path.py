"""Paths of an object on its support that consist of stable pushes: along the normals of its sides, straight or in arcs.

Straight fingers on a side push an object stably only within narrow limits (Lynch & Mason, "Stable pushing", IJRR
1996): straight ahead, or in an arc with a curvature that is proportional to the distance of the push from the middle
of the side. Pushes often cannot follow a path that was planned for the object alone. This module replaces such a path
by a sequence of legs that pushes can follow. Each leg is a push on one side. A straight leg pushes at the middle of
the side. An arc of curvature k needs the moment f k c^2 about the centre of friction, where c is the characteristic
length of the limit surface, so its push is k c^2 beside the middle. The pressure distribution under the object, and so
c, is never known exactly; wide arcs depend less on it and are preferred.

Without obstacles, such a path exists between any two poses: an arc that rotates the object, and two straight legs
along sides that enclose the remaining direction. A shortest-path search determines which poses of the given path are
connected by which legs. It checks legs only if they are on the shortest path (Bohlin & Kavraki, "Path planning using
lazy PRM", ICRA 2000).
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.contacts.facets import facets
from hmap_core.contacts.push import FRICTION_SHARE, UPRIGHT, SlidingBody
from hmap_core.transforms import consistent, distance, wrapped
from hmap_core.types import Body
from hmap_core.waypoints.checker import Geometry, ObjectChecker, planar_pose, planar_yaw
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import POSITION_STEP, resample

SAME_CORNER = 1e-4  # m; corners of a footprint that are nearer are the same
SAME_NORMAL = float(np.cos(np.deg2rad(2.0)))  # between a face and the footprint's edge below it
SAME_HEADING = 3  # digits of an angle in rad
ROUND = np.deg2rad([0.0, 90.0, 180.0, 270.0]).tolist()  # headings of a body without straight sides, rad
END_DISTANCE = 0.01  # m; no pushes this close to the ends of a side
PUSH_POINT_TOLERANCE = 0.01  # m; uncertainty of an arc's push point that costs nothing
CURVATURES = (1.0, 3.0, 10.0)  # curvatures that are tried, relative to the largest one within PUSH_POINT_TOLERANCE
UNCERTAIN_TURN_COST = 1.0  # m of path; largest cost of the uncertainty per rad of rotation
SLANT_SHARE = 0.5  # share of the friction cone by which a straight leg can deviate from the normal
LEG_COST = 0.3  # m of path; cost of each leg
SHORT, SHORT_COST = 0.03, 0.3  # m; legs shorter than the first number cost the second in addition
# largest random cost factors of a side and of a connection, to find different paths
SIDE_COST_FACTOR, CONNECTION_COST_FACTOR = 4.0, 1.5
NODE_STEP = 0.08  # m between poses of the path that can be connected; a rotation by 1 rad counts as the body's radius
MAX_NODES = 24  # largest number of poses that can be connected
MAX_TURNED_NODES = 8  # the same if each is turned in two ways as well
# m beside the path of poses that can be connected as well, so that fewer legs get round a corner
BESIDE = (0.0, 0.03, -0.03, 0.06, -0.06)
MAX_NODES_BESIDE = 14  # largest number of poses of the path for which others beside them are looked at
TURNED = float(np.deg2rad(45.0))  # rad; turns on the way, so that the sides face other directions
AVOIDED = float(np.deg2rad(30.0))  # rad between a leg and a direction that is avoided
MAX_LEGS = 4000  # number of checked legs after which the search fails
ARC_STEP = float(np.deg2rad(3.0))  # rad; arcs are checked and sampled as chords
LEVEL = 1e-3  # m; largest height difference of a planar path
MIN_LENGTH = 1e-4  # m; shorter legs are ignored
MIN_TURN = 1e-3  # rad; smaller rotations are ignored


@dataclass(frozen=True)
class Side:
    """A side of an object that can be pushed, in level axes fixed to the object.

    Attributes:
        heading: direction of the inward normal, rad.
        curvature: (2,) largest curvatures to the right (at most 0) and to the left (at least 0), 1/m.
    """

    heading: float
    curvature: tuple[float, float]


@dataclass(frozen=True)
class Leg:
    """A push that moves the object's centre of friction along an arc.

    Attributes:
        side: index of the pushed side.
        heading: direction of motion at the start, world frame, rad.
        length: m.
        curvature: 1/m.
    """

    side: int
    heading: float
    length: float
    curvature: float = 0.0

    @property
    def turn(self) -> float:
        """Rotation of the object, rad."""
        return self.curvature * self.length

    def along(self, way: float) -> np.ndarray:
        """Displacement (2,) in m after ``way`` m."""
        a, b = self.heading, self.heading + self.curvature * way
        if abs(self.curvature * way) < MIN_TURN:
            return way * np.array([np.cos(0.5 * (a + b)), np.sin(0.5 * (a + b))])
        return np.array([np.sin(b) - np.sin(a), np.cos(a) - np.cos(b)]) / self.curvature


def sides(body: Body, slide: SlidingBody) -> list[Side]:
    """The sides of a sliding body that can be pushed: flat, upright, outermost, in front of its middle."""
    corners = np.concatenate(slide.footprint) - slide.middle
    corners = corners[np.unique(np.round(corners / SAME_CORNER), axis=0, return_index=True)[1]]
    outline = corners[ConvexHull(corners).vertices]  # counter-clockwise
    normals = np.array([facet.normal for facet in facets(body.shapes)]) @ slide.level.T
    normals = normals[np.abs(normals[:, 2]) <= np.sin(UPRIGHT), :2]
    found: dict[float, tuple[float, list[float]]] = {}
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        inward = np.array([-along[1], along[0]])
        if (normals @ -inward >= SAME_NORMAL * np.linalg.norm(normals, axis=1)).any():
            heading = float(np.arctan2(inward[1], inward[0]))
            found.setdefault(round(heading, SAME_HEADING), (heading, []))[1].extend([start @ along, end @ along])
    return [
        Side(heading, ((min(beside) + END_DISTANCE) / slide.length**2, (max(beside) - END_DISTANCE) / slide.length**2))
        for heading, beside in sorted(found.values())
        if min(beside) + END_DISTANCE <= 0.0 <= max(beside) - END_DISTANCE
    ]


def final_pushes(body: Body, T: np.ndarray, steps: int) -> list[np.ndarray]:
    """The last centimetres of straight pushes to a pose.

    Args:
        body: the object.
        T: T_world_obj (7,) at the end.
        steps: number of poses.

    Returns:
        Poses (steps, 7) for each side of the body; in some directions, where it has none, as a disc that is dragged.
    """
    return _straight_pushes(body, T, np.arange(1 - steps, 1))


def first_pushes(body: Body, T: np.ndarray, steps: int) -> list[np.ndarray]:
    """The first centimetres of straight pushes from a pose.

    Args:
        body: the object.
        T: T_world_obj (7,) at the start.
        steps: number of poses.

    Returns:
        Poses (steps, 7) for each side of the body; in some directions, where it has none, as a disc that is dragged.
    """
    return _straight_pushes(body, T, np.arange(steps))


def _straight_pushes(body: Body, T: np.ndarray, ahead: np.ndarray) -> list[np.ndarray]:
    """Poses (M, 7) of straight pushes through a pose T (7,): steps (M,) ahead of it, for each side of the body."""
    slide = SlidingBody(body, T)
    if not slide.footprint:
        return []
    found = []
    for heading in [side.heading for side in sides(body, slide)] or ROUND:
        poses = np.tile(np.asarray(T, float), (len(ahead), 1))
        poses[:, :2] += POSITION_STEP * ahead[:, None] * [np.cos(heading), np.sin(heading)]
        found.append(poses)
    return found


class PushPlanner:
    """Plans paths of one object that consist of pushes, from the start of a problem to its goal.

    Args:
        problem: the object and its obstacles; the motion is planar and no obstacle is removable.

    Attributes:
        legs: number of pushes in the last path.
        slant: rad by which the direction of a straight leg may deviate from the normal of its side.
        robust_curvature: 1/m, up to which the pressure distribution under the object hardly matters.
    """

    def __init__(self, problem: ObjectPathProblem):
        self.problem = replace(problem, motion="planar", removable=frozenset())
        self.slide = SlidingBody(problem.body, problem.start)
        self.sides = sides(problem.body, self.slide) if self.slide.footprint else []
        self.slant = SLANT_SHARE * float(np.arctan(FRICTION_SHARE * problem.body.friction))
        self.checker = ObjectChecker(self.problem, Geometry(self.problem), True, problem.min_distance)
        self.legs = 0
        self.robust_curvature = (
            PUSH_POINT_TOLERANCE / abs(self.slide.rim_length**2 - self.slide.length**2) if self.sides else np.inf
        )
        self._legs_left = MAX_LEGS

    def path(
        self, poses: np.ndarray, rng: np.random.Generator | None, avoided: Sequence[float] = ()
    ) -> np.ndarray | None:
        """Plan a free path of pushes near a given planar path.

        Args:
            poses: (M, 7) free path from the problem's start to its goal.
            rng: increases the cost of some sides at random, so that each call finds another path; None: the shortest
                path.
            avoided: directions in rad, world frame, in which the object is not pushed; it may turn on its way then, so
                that others serve.

        Returns:
            Poses (K, 7). None if the given path rises, if the body does not stand on its support or has no flat sides,
            or if no path was found.
        """
        if len(self.sides) < 3 or self.checker.support is None or np.ptp(poses[:, 2]) > LEVEL:
            return None
        self._legs_left = MAX_LEGS
        side_cost = np.ones(len(self.sides)) if rng is None else rng.uniform(1.0, SIDE_COST_FACTOR, len(self.sides))
        states = [self.state(T) for T in self._nodes(poses, MAX_TURNED_NODES if avoided else MAX_NODES)]
        if avoided:
            states = _with_turns(states)
        elif len(states) <= MAX_NODES_BESIDE and all(
            abs(wrapped(state[2] - states[0][2])) < MIN_TURN for state in states
        ):
            states = _with_sides(states)
        order, before = count(), {}
        queue: list[tuple[float, int, int, int, tuple[Leg, ...]]] = [(0.0, 0, 0, -1, ())]
        while queue:
            cost, _, at, source, legs = heapq.heappop(queue)
            if at in before or (legs and not self.free(states[source], legs)):
                continue
            if self._legs_left <= 0:
                return None
            before[at] = source, legs
            if at == len(states) - 1:
                return self._dense_path(poses[0], poses[-1], states, before)
            for to in range(at + 1, len(states)):
                for legs_to in self._connections(states[at], states[to]):
                    if any(_is_along(leg, direction) for leg in legs_to for direction in avoided):
                        continue
                    more = sum(side_cost[leg.side] * self._cost(leg) for leg in legs_to)
                    more *= 1.0 if rng is None else rng.uniform(1.0, CONNECTION_COST_FACTOR)
                    heapq.heappush(queue, (cost + more, next(order), to, at, legs_to))
        return None

    def _cost(self, leg: Leg) -> float:
        uncertain = 1.0 - min(1.0, self.robust_curvature / abs(leg.curvature)) if leg.curvature else 0.0
        short = SHORT_COST if leg.length < SHORT else 0.0
        return LEG_COST + short + leg.length + UNCERTAIN_TURN_COST * abs(leg.turn) * uncertain

    def _nodes(self, poses: np.ndarray, most: int) -> np.ndarray:
        """At most ``most`` poses of a path that can be connected: evenly distributed along it, including both ends."""
        steps = [d + self.checker.radius * angle for d, angle in map(distance, poses[:-1], poses[1:])]
        way = np.concatenate([[0.0], np.cumsum(steps)])
        wanted = np.linspace(0.0, way[-1], int(np.clip(np.ceil(way[-1] / NODE_STEP), 1, most - 1)) + 1)
        return poses[np.unique(np.searchsorted(way, wanted - MIN_LENGTH))]

    def state(self, T: np.ndarray) -> np.ndarray:
        """x, y of the centre of friction and yaw (3,) at a pose (7,)."""
        yaw = planar_yaw(self.problem.start, T)
        return np.r_[T[:2] + _turned(self.slide.middle, yaw), yaw]

    def pose(self, state: np.ndarray) -> np.ndarray:
        """The pose (7,) of the object in a state (3,)."""
        x, y = state[:2] - _turned(self.slide.middle, state[2])
        return planar_pose(self.problem.start, x, y, state[2])

    def _connections(self, a: np.ndarray, b: np.ndarray) -> list[tuple[Leg, ...]]:
        """Sequences of legs from one state (3,) to another, without regard to obstacles."""
        turn = wrapped(b[2] - a[2])
        if abs(turn) < MIN_TURN:
            return self._straight(b[:2] - a[:2], a[2])
        found = []
        for k, side in enumerate(self.sides):
            most = abs(side.curvature[int(turn > 0.0)])
            for curvature in sorted({min(most, units * self.robust_curvature) for units in CURVATURES}):
                if curvature < MIN_TURN:
                    continue
                curvature = np.copysign(curvature, turn)
                # the straight legs are before or after the arc
                for first in (True, False):
                    arc = Leg(k, side.heading + a[2], turn / curvature, curvature)
                    rest = b[:2] - a[:2] - arc.along(arc.length)
                    for legs in self._straight(rest, a[2] if first else b[2]):
                        found.append((*legs, arc) if first else (arc, *legs))
        return found

    def _straight(self, way: np.ndarray, yaw: float) -> list[tuple[Leg, ...]]:
        """One or two straight legs with the sum ``way`` (2,), in both orders, for an object with this yaw."""
        length = float(np.hypot(*way))
        if length < MIN_LENGTH:
            return [()]
        heading = float(np.arctan2(way[1], way[0]))
        off = np.array([wrapped(side.heading + yaw - heading) for side in self.sides])
        nearest = int(np.abs(off).argmin())
        if abs(off[nearest]) <= self.slant:
            return [(Leg(nearest, heading, length),)]
        left, right = np.where(off > 0.0, off, np.inf), np.where(off < 0.0, -off, np.inf)
        i, j = int(left.argmin()), int(right.argmin())
        if left[i] + right[j] >= np.pi - MIN_TURN:
            return []
        share = length / np.sin(left[i] + right[j])
        one = Leg(i, heading + left[i], share * float(np.sin(right[j])))
        other = Leg(j, heading - right[j], share * float(np.sin(left[i])))
        return [(one, other), (other, one)]

    def states(self, state: np.ndarray, leg: Leg) -> list[np.ndarray]:
        """States along a leg that starts at a state, without that state."""
        steps = max(1, int(np.ceil(abs(leg.turn) / ARC_STEP)))
        ways = leg.length * np.arange(1, steps + 1) / steps
        return [np.r_[state[:2] + leg.along(way), state[2] + leg.curvature * way] for way in ways]

    def free(self, state: np.ndarray, legs: Sequence[Leg]) -> bool:
        """Whether the object is free along legs from a state (3,) on."""
        at = self.pose(state)
        for leg in legs:
            self._legs_left -= 1
            along = self.states(state, leg)
            state = along[-1]
            for to in map(self.pose, along):
                if not self.checker.motion_free(at, to):
                    return False
                at = to
        return True

    def _dense_path(self, first: np.ndarray, last: np.ndarray, states, before) -> np.ndarray:
        """The dense poses of the solution's legs."""
        sequence, at = [], len(states) - 1
        while at:
            at, legs = before[at]
            sequence.append((at, legs))
        corners = [first]
        self.legs = sum(len(legs) for _, legs in sequence)
        for at, legs in reversed(sequence):
            corners += self.poses_along(states[at], legs)
        corners[-1] = last
        return consistent(resample(np.array(corners))[0])

    def poses_along(self, state: np.ndarray, legs: Sequence[Leg]) -> list[np.ndarray]:
        """Poses (7,) along legs from a state (3,) on, without that state."""
        poses = []
        for leg in legs:
            along = self.states(state, leg)
            poses += [self.pose(s) for s in along]
            state = along[-1]
        return poses


def _with_turns(states: list[np.ndarray]) -> list[np.ndarray]:
    """States (3,), each turned in place to both sides as well; the first and the last stay at the ends."""
    *others, last = states
    before = [state + [0.0, 0.0, turn] for state in others for turn in (0.0, TURNED, -TURNED)]
    return [*before, last + [0.0, 0.0, TURNED], last - [0.0, 0.0, TURNED], last]


def _with_sides(states: list[np.ndarray]) -> list[np.ndarray]:
    """States (3,), each displaced to both sides of the path as well; the first and the last stay alone."""
    found = states[:1]
    for before, state, after in zip(states, states[1:], states[2:], strict=False):
        way = after[:2] - before[:2]
        across = np.array([-way[1], way[0], 0.0]) / max(float(np.hypot(*way)), MIN_LENGTH)
        found += [state + beside * across for beside in BESIDE]
    return [*found, *states[1:][-1:]]


def _is_along(leg: Leg, direction: float) -> bool:
    """Whether a leg goes in a direction (rad), on the average."""
    return abs(wrapped(leg.heading + 0.5 * leg.turn - direction)) < AVOIDED


def _turned(p: np.ndarray, yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * p[0] - s * p[1], s * p[0] + c * p[1]])
