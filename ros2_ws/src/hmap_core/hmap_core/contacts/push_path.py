"""A path of an object on its support that is made of pushes: along the normals of its sides, straight or in arcs.

Straight fingers on a side carry an object stably only within narrow bounds (Lynch & Mason, "Stable pushing", IJRR
1996): straight on, or round a turn whose curvature goes with how far beside the middle they push. So a path that was
found for the object alone can often not be pushed at all. Here it is replaced by legs that can. Each leg is a push on
one side. A straight one is pushed at the middle of the side. An arc of curvature k needs the moment f k c^2 about the
centre of friction, c the characteristic length of the limit surface, so it is pushed k c^2 beside the middle. How the
weight rests on the support is never known, and c with it; so wide arcs, for which this matters little, are preferred.

Between two poses there is always such a way if nothing stands in it: an arc that turns, and two straight legs along
sides that enclose the rest of the way. Which poses of the path are joined, and by which legs, is a shortest path, whose
legs are checked only when they are on it (Bohlin & Kavraki, "Path planning using lazy PRM", ICRA 2000).
"""

import heapq
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.contacts.facets import facets
from hmap_core.contacts.push import FRICTION_SHARE, UPRIGHT, Slide
from hmap_core.transforms import consistent, distance
from hmap_core.types import Body
from hmap_core.waypoints.checker import Geometry, ObjectChecker, planar_pose, planar_yaw
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import POSITION_STEP, resample

SAME_CORNER = 1e-4  # m between corners of a footprint that are one
SAME_NORMAL = float(np.cos(np.deg2rad(2.0)))  # of a face and of the edge of the footprint below it
SAME_HEADING = 3  # digits of a rad
FROM_END = 0.01  # m from the ends of a side, within which it is not pushed
UNSURE = 0.01  # m by which the place to push for an arc may be uncertain without a price
CURVATURES = (1.0, 3.0, 10.0)  # that are tried, in units of that for which it is
UNSURE_COST = 1.0  # m of path that a turn by 1 rad costs at most for being uncertain
SLANT_SHARE = 0.5  # of the friction cone that a straight leg may leave the normal by
LEG_COST = 0.3  # m of path that a further leg is worth
SHORT, SHORT_COST = 0.03, 0.3  # m; a leg shorter than that costs as much as so many metres more
SIDE_VARIETY, WAY_VARIETY = 4.0, 1.5  # a side, or a way, costs up to so many times more where other ways are wanted
KNOT_STEP = 0.08  # m between poses of the path that may be joined; a turn by 1 rad counts as the body's length
MAX_KNOTS = 24  # poses that may be joined
MAX_LEGS = 4000  # legs checked before there counts as being no way
ARC_STEP = float(np.deg2rad(3.0))  # rad; arcs are checked and followed in chords
LEVEL = 1e-3  # m that a path of an object that slides may rise
NO_LEG = 1e-4  # m, shorter than any leg
NO_TURN = 1e-3  # rad, less than any turn


@dataclass(frozen=True)
class Side:
    """A side of an object that can be pushed, in level axes fixed to it.

    Attributes:
        heading: direction of the inward normal, rad.
        curvature: (2,) the largest to the right (at most 0) and to the left (at least 0), 1/m.
    """

    heading: float
    curvature: tuple[float, float]


@dataclass(frozen=True)
class Leg:
    """A push: the object's centre of friction goes ``length`` m from ``heading`` (rad, world) on, with a curvature.

    ``side`` is the index of the side that is pushed.
    """

    side: int
    heading: float
    length: float
    curvature: float = 0.0

    @property
    def turn(self) -> float:
        """How far the object turns, rad."""
        return self.curvature * self.length

    def along(self, way: float) -> np.ndarray:
        """Displacement (2,) in metres after ``way`` m."""
        a, b = self.heading, self.heading + self.curvature * way
        if abs(self.curvature * way) < NO_TURN:
            return way * np.array([np.cos(0.5 * (a + b)), np.sin(0.5 * (a + b))])
        return np.array([np.sin(b) - np.sin(a), np.cos(a) - np.cos(b)]) / self.curvature


def sides(body: Body, slide: Slide) -> list[Side]:
    """The sides of a body that slides: flat, upright, outermost, and in the way of its middle."""
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
        Side(heading, ((min(beside) + FROM_END) / slide.length**2, (max(beside) - FROM_END) / slide.length**2))
        for heading, beside in sorted(found.values())
        if min(beside) + FROM_END <= 0.0 <= max(beside) - FROM_END
    ]


def ways_in(body: Body, T: np.ndarray, steps: int) -> list[np.ndarray]:
    """Poses (steps, 7) of the last centimetres of straight pushes to pose T (7,), one for each side of a body."""
    slide = Slide(body, T)
    found = []
    for side in sides(body, slide) if slide.footprint else []:
        poses = np.tile(np.asarray(T, float), (steps, 1))
        back = POSITION_STEP * np.arange(steps)[::-1]
        poses[:, :2] -= back[:, None] * [np.cos(side.heading), np.sin(side.heading)]
        found.append(poses)
    return found


class PushPlanner:
    """Ways of one object made of pushes, from the start of a problem to its goal."""

    def __init__(self, problem: ObjectPathProblem):
        self.problem = replace(problem, motion="planar", removable=frozenset())
        self.slide = Slide(problem.body, problem.start)
        self.sides = sides(problem.body, self.slide) if self.slide.footprint else []
        self.slant = SLANT_SHARE * float(np.arctan(FRICTION_SHARE * problem.body.friction))
        self.checker = ObjectChecker(self.problem, Geometry(self.problem), True, problem.min_distance)
        # the curvature, 1/m, up to which it hardly matters how the weight rests on the support
        self._sure = UNSURE / abs(self.slide.rim_length**2 - self.slide.length**2) if self.sides else np.inf
        self._legs_left = MAX_LEGS

    def path(self, poses: np.ndarray, rng: np.random.Generator | None) -> np.ndarray | None:
        """Poses (K, 7) of a free path that can be pushed leg by leg, near the free planar path ``poses`` (M, 7).

        Args:
            poses: from the problem's start to its goal.
            rng: prefers some sides at random, so that each call finds another way; None: the shortest.

        Returns:
            None where the path rises, the body does not stand on its support, has no flat sides, or no way was found.
        """
        if len(self.sides) < 3 or self.checker.support is None or np.ptp(poses[:, 2]) > LEVEL:
            return None
        self._legs_left = MAX_LEGS
        price = np.ones(len(self.sides)) if rng is None else rng.uniform(1.0, SIDE_VARIETY, len(self.sides))
        knots = self._knots(poses)
        states = [self._state(T) for T in knots]
        order, queue, before = count(), [(0.0, 0, 0, -1, ())], {}
        while queue:
            cost, _, at, source, legs = heapq.heappop(queue)
            if at in before or (legs and not self._free(states[source], legs)):
                continue
            if self._legs_left <= 0:
                return None
            before[at] = source, legs
            if at == len(states) - 1:
                return self._followed(poses[0], poses[-1], states, before)
            for to in range(at + 1, len(states)):
                for way in self._ways(states[at], states[to]):
                    more = sum(price[leg.side] * self._cost(leg) for leg in way)
                    more *= 1.0 if rng is None else rng.uniform(1.0, WAY_VARIETY)
                    heapq.heappush(queue, (cost + more, next(order), to, at, way))
        return None

    def _cost(self, leg: Leg) -> float:
        unsure = 1.0 - min(1.0, self._sure / abs(leg.curvature)) if leg.curvature else 0.0
        short = SHORT_COST if leg.length < SHORT else 0.0
        return LEG_COST + short + leg.length + UNSURE_COST * abs(leg.turn) * unsure

    def _knots(self, poses: np.ndarray) -> np.ndarray:
        """Poses of a path that may be joined: evenly spread along it, both ends among them."""
        steps = [d + self.checker.radius * angle for d, angle in map(distance, poses[:-1], poses[1:])]
        way = np.concatenate([[0.0], np.cumsum(steps)])
        wanted = np.linspace(0.0, way[-1], int(np.clip(np.ceil(way[-1] / KNOT_STEP), 1, MAX_KNOTS - 1)) + 1)
        return poses[np.unique(np.searchsorted(way, wanted - NO_LEG))]

    def _state(self, T: np.ndarray) -> np.ndarray:
        """x, y of the centre of friction and yaw (3,) of a pose."""
        yaw = planar_yaw(self.problem.start, T)
        return np.r_[T[:2] + _turned(self.slide.middle, yaw), yaw]

    def _pose(self, state: np.ndarray) -> np.ndarray:
        x, y = state[:2] - _turned(self.slide.middle, state[2])
        return planar_pose(self.problem.start, x, y, state[2])

    def _ways(self, a: np.ndarray, b: np.ndarray) -> list[tuple[Leg, ...]]:
        """Sequences of legs from a state (3,) to another, as if nothing stood around."""
        turn = _wrapped(b[2] - a[2])
        if abs(turn) < NO_TURN:
            return self._straight(b[:2] - a[:2], a[2])
        found = []
        for k, side in enumerate(self.sides):
            most = abs(side.curvature[int(turn > 0.0)])
            for curvature in sorted({min(most, units * self._sure) for units in CURVATURES}):
                if curvature < NO_TURN:
                    continue
                curvature = np.copysign(curvature, turn)
                # the straight legs come before the arc, or after it
                for first in (True, False):
                    arc = Leg(k, side.heading + a[2], turn / curvature, curvature)
                    rest = b[:2] - a[:2] - arc.along(arc.length)
                    for legs in self._straight(rest, a[2] if first else b[2]):
                        found.append((*legs, arc) if first else (arc, *legs))
        return found

    def _straight(self, way: np.ndarray, yaw: float) -> list[tuple[Leg, ...]]:
        """One or two straight legs that sum up to ``way`` (2,), in both orders, of an object turned by ``yaw``."""
        length = float(np.hypot(*way))
        if length < NO_LEG:
            return [()]
        heading = float(np.arctan2(way[1], way[0]))
        off = np.array([_wrapped(side.heading + yaw - heading) for side in self.sides])
        nearest = int(np.abs(off).argmin())
        if abs(off[nearest]) <= self.slant:
            return [(Leg(nearest, heading, length),)]
        left, right = np.where(off > 0.0, off, np.inf), np.where(off < 0.0, -off, np.inf)
        i, j = int(left.argmin()), int(right.argmin())
        if left[i] + right[j] >= np.pi - NO_TURN:
            return []
        share = length / np.sin(left[i] + right[j])
        one = Leg(i, heading + left[i], share * float(np.sin(right[j])))
        other = Leg(j, heading - right[j], share * float(np.sin(left[i])))
        return [(one, other), (other, one)]

    def _states(self, state: np.ndarray, leg: Leg) -> list[np.ndarray]:
        """States along a leg that begins at a state, without that one."""
        steps = max(1, int(np.ceil(abs(leg.turn) / ARC_STEP)))
        ways = leg.length * np.arange(1, steps + 1) / steps
        return [np.r_[state[:2] + leg.along(way), state[2] + leg.curvature * way] for way in ways]

    def _free(self, state: np.ndarray, legs: tuple[Leg, ...]) -> bool:
        at = self._pose(state)
        for leg in legs:
            self._legs_left -= 1
            along = self._states(state, leg)
            state = along[-1]
            for to in map(self._pose, along):
                if not self.checker.motion_free(at, to):
                    return False
                at = to
        return True

    def _followed(self, first: np.ndarray, last: np.ndarray, states, before) -> np.ndarray:
        """The dense poses of the legs that were found."""
        sequence, at = [], len(states) - 1
        while at:
            at, legs = before[at]
            sequence.append((at, legs))
        corners = [first]
        for at, legs in reversed(sequence):
            state = states[at]
            for leg in legs:
                along = self._states(state, leg)
                corners += [self._pose(s) for s in along]
                state = along[-1]
        corners[-1] = last
        return consistent(resample(np.array(corners))[0])


def _turned(p: np.ndarray, yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * p[0] - s * p[1], s * p[0] + c * p[1]])


def _wrapped(angle: float) -> float:
    """The angle in rad, in [-pi, pi)."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
