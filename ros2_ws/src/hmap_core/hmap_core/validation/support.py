"""Whether an object at rest is carried: what lies under it, and where its centre of mass is.

The object is lowered by ``limits.SUPPORT_GAP``. Where it then overlaps another body, and would not if it were raised,
it is carried; seen from above, the hull of all those places is its region of support, and its centre of mass must lie
inside.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from hmap_core.validation import limits
from hmap_core.validation.contacts import Contact, runs
from hmap_core.validation.geometry import Gauge, polytope_points, transform
from hmap_core.validation.objects import deviation
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, World

EMPTY = 1e-7  # m, inscribed radius under which an overlap counts as none
CLEARLY = 1e-4  # m, how deep inside an overlap a guessed point must be; a thousand times what counts as one
TOWARDS_MIDDLE = np.geomspace(1e-4, 1.0, 40)  # parts of the way that are tried
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Support:
    """What carries an object at one instant.

    Attributes:
        bodies: the bodies under it.
        gap: distance in metres to the nearest other body.
        inside: how far the centre of mass is inside the region of support, seen from above; negative outside.
    """

    bodies: frozenset[str]
    gap: float
    inside: float

    @property
    def stable(self) -> bool:
        return bool(self.bodies) and self.inside >= limits.STABLE_MARGIN


def _halfspaces(points: np.ndarray) -> np.ndarray:
    """The hull of points (V, 3) as rows [normal, offset] with normal @ x + offset <= 0 inside."""
    return np.unique(np.round(ConvexHull(points).equations, 12), axis=0)


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """Corners (n, 3) of the intersection of the hulls of two sets of points; None when it is empty."""
    of_a, of_b = _halfspaces(a), _halfspaces(b)
    if _beyond_a_face(a, of_b) or _beyond_a_face(b, of_a):
        return None
    rows = np.vstack([of_a, of_b])
    center = _guessed_inside(a, of_a, b, of_b)
    if center is None:
        center = _center(rows)
    try:
        return None if center is None else HalfspaceIntersection(rows, center).intersections
    except QhullError:
        return None


def _depth(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far points (n, 3) are inside halfspaces (m, 4), (n,) in metres; negative outside."""
    return -(points @ rows[:, :3].T + rows[:, 3]).max(axis=1)


def _beyond_a_face(points: np.ndarray, rows: np.ndarray) -> bool:
    """Whether no ball of radius ``EMPTY`` within the hull of points (n, 3) fits inside one of the halfspaces (m, 4)."""
    return bool(np.any((points @ rows[:, :3].T + rows[:, 3]).min(axis=0) > -2.0 * EMPTY))


def _guessed_inside(a: np.ndarray, of_a: np.ndarray, b: np.ndarray, of_b: np.ndarray) -> np.ndarray | None:
    """A point (3,) at least ``CLEARLY`` inside two hulls, the points and halfspaces of which are given.

    The mean of the corners that one has in the other, moved towards the middle of the first: finds one where a body
    stands on another. None means nothing.
    """
    corners = np.vstack([a[_depth(of_b, a) >= 0.0], b[_depth(of_a, b) >= 0.0]])
    if len(corners) == 0:
        return None
    begin = corners.mean(axis=0)
    points = begin + TOWARDS_MIDDLE[:, None] * (a.mean(axis=0) - begin)
    depth = np.minimum(_depth(of_a, points), _depth(of_b, points))
    return points[depth.argmax()] if depth.max() >= CLEARLY else None


def _center(rows: np.ndarray) -> np.ndarray | None:
    """The centre (3,) of the largest ball inside all halfspaces (m, 4); None when it is smaller than ``EMPTY``."""
    # maximise r with normal @ x + r + offset <= 0
    bounds = [(None, None)] * 3 + [(0.0, None)]
    table = np.column_stack([rows[:, :3], np.ones(len(rows))])
    lp = linprog([0, 0, 0, -1], A_ub=table, b_ub=-rows[:, 3], bounds=bounds)
    return lp.x[:3] if lp.success and lp.x[3] >= EMPTY else None


def _inside(points: np.ndarray, center: np.ndarray) -> float:
    """How far a point (2,) is inside the hull of points (n, 2) in metres; negative outside."""
    try:
        equations = ConvexHull(points).equations
    except QhullError:  # a point or a line carries nothing
        return -float(np.linalg.norm(points - center, axis=1).min())
    return -float(np.max(equations[:, :2] @ center + equations[:, 2]))


def center_of_mass(world: World, name: str, k: int) -> np.ndarray:
    """Centre of mass (3,) of a body of uniform density at sample k, world frame."""
    parts = world.parts_of(name)
    volumes = np.array([part.solid.volume for part in parts])
    tracks = [world.tracks[part] for part in parts]
    centers = np.array([t.R[k] @ t.part.solid.centroid + t.p[k] for t in tracks])
    return volumes @ centers / volumes.sum()


class Supporter:
    """Finds what carries the bodies of a world."""

    def __init__(self, world: World):
        self._world = world
        self._bodies = [part for part in world.parts if part.link is None]
        self._known: dict[tuple, tuple[float, np.ndarray | None]] = {}  # most bodies stand still most of the time

    def at(self, name: str, k: int) -> Support:
        """What carries a body at sample k."""
        carriers, places, gap = set(), [], np.inf
        for part in self._world.parts_of(name):
            for other in self._bodies:
                if other.holder != name:
                    distance, place = self._remembered(part, other, k)
                    gap = min(gap, distance)
                    if place is not None:
                        carriers.add(other.holder)
                        places.append(place[:, :2])
        if not places:
            return Support(frozenset(), gap, -np.inf)
        center = center_of_mass(self._world, name, k)
        return Support(frozenset(carriers), gap, _inside(np.vstack(places), center[:2]))

    def _remembered(self, part: Part, other: Part, k: int) -> tuple[float, np.ndarray | None]:
        poses = self._world.poses
        key = part, other, poses[part.holder][k].tobytes(), poses[other.holder][k].tobytes()
        if key not in self._known:
            self._known[key] = self._contact(part, other, k)
        return self._known[key]

    def _contact(self, part: Part, other: Part, k: int) -> tuple[float, np.ndarray | None]:
        """The distance in metres, and where the other part carries this one: corners (n, 3)."""
        a, b = self._world.tracks[part], self._world.tracks[other]
        gauge = Gauge(part.solid, other.solid)
        distance = gauge.distance(a.at(k), b.at(k))
        if distance > limits.SUPPORT_GAP:
            return distance, None
        raised = transform(a.R[k], a.p[k] - limits.GRAVITY_SLIDE * DOWN)
        if gauge.distance(raised, b.at(k)) <= EMPTY:
            return distance, None
        lowered = polytope_points(part.solid, a.R[k], a.p[k] + limits.SUPPORT_GAP * DOWN)
        return distance, overlap(lowered, polytope_points(other.solid, b.R[k], b.p[k]))


def _moved(world: World, name: str, k: int) -> bool:
    distance, angle = deviation(world.poses[name][k : k + 1], world.document.bodies[name].pose)
    return bool(distance[0] > limits.UNTOUCHED_POSITION or angle[0] > limits.UNTOUCHED_ROTATION)


def _report(support: Support, name: str, time: float, findings: Findings) -> None:
    if support.stable:
        return
    if not support.bodies:
        amount, limit = support.gap, limits.SUPPORT_GAP
        findings.add(Kind.UNSUPPORTED, (name,), time, amount, limit, amount)
    else:
        bodies = (name, *sorted(support.bodies))
        findings.add(Kind.UNSUPPORTED, bodies, time, -support.inside, -limits.STABLE_MARGIN, -support.inside)


def _pushed_samples(world: World, contact: Contact) -> list[int]:
    """Samples of a push at which the support is looked at: every ``SUPPORT_CHECK_STEP`` of travel, and the end."""
    poses = world.poses[contact.object][contact.window]
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))])
    marks = np.arange(0.0, travel[-1], limits.SUPPORT_CHECK_STEP)
    return sorted({contact.segment.first + int(i) for i in (*np.searchsorted(travel, marks), len(travel) - 1)})


class SupportCheck:
    """Reports objects that are not carried, and remembers who carries whom."""

    def __init__(self, world: World, contacts: list[Contact], findings: Findings):
        self._world = world
        self._contacts = contacts
        self._findings = findings
        self._supporter = Supporter(world)
        self.pairs: set[frozenset[str]] = set()  # an object and a body that carries it at some time

    def run(self) -> None:
        """Look at every object whenever nothing holds it, and at pushed ones on their way."""
        names = [name for name, body in self._world.document.bodies.items() if not body.fixed]
        for name in names:
            self._check_free(name)
        if self._world.document.mode == "physical":
            for contact in self._contacts:
                if contact.kind == "push":
                    self._check_pushed(contact)

    def _look(self, name: str, k: int) -> Support:
        support = self._supporter.at(name, k)
        self.pairs |= {frozenset((name, body)) for body in support.bodies}
        return support

    def _check_free(self, name: str) -> None:
        """An object that the plan has put down, or under which it has taken the support away, must be carried."""
        stable_before = self._look(name, 0).stable
        free = np.ones(self._world.samples - 1, bool)
        for contact in self._contacts:
            if contact.object == name:
                free[contact.segment.first : contact.segment.last] = False
        for first, last in runs(free):
            for k in self._changes(first, last):
                if stable_before or _moved(self._world, name, k):
                    _report(self._look(name, k), name, self._world.document.time[k], self._findings)

    def _changes(self, first: int, last: int) -> list[int]:
        """The ends of a stretch and the ends of segments within it: when other bodies may have come or gone."""
        ends = {k for s in self._world.document.segments for k in (s.first, s.last) if first < k < last}
        return sorted({first, last} | ends)

    def _check_pushed(self, contact: Contact) -> None:
        """A pushed object is carried by the scene and not by the robot."""
        for k in _pushed_samples(self._world, contact):
            _report(self._look(contact.object, k), contact.object, self._world.document.time[k], self._findings)
