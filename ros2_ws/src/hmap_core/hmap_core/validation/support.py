"""Static support: which bodies carry an object at rest, and whether its centre of mass is above them.

The object is lowered by ``limits.SUPPORT_GAP``. Another body supports it where the two then overlap, and would not
overlap if the object were raised. The support region is the convex hull of all these patches in the horizontal plane;
the centre of mass must project into it. If it does not, or if the object could roll, the equilibrium of contact forces
decides (:mod:`hmap_core.validation.rest`).
"""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from hmap_core.validation import limits, rest
from hmap_core.validation.contacts import Contact, runs
from hmap_core.validation.geometry import Polytope, transform
from hmap_core.validation.near import nearest_first
from hmap_core.validation.objects import deviation
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, World

MIN_RADIUS = 1e-7  # m, inscribed radius below which an overlap counts as empty
SAMPLED_DEPTH = 1e-4  # m, depth inside an overlap that a sampled interior point must have
CENTER_FRACTIONS = np.geomspace(1e-4, 1.0, 40)  # sampled fractions of the line to the centre
NEARBY = 2.0 * limits.ROLL_ROOM  # m; parts that are farther apart cannot matter for how a body rests
UPRIGHT = 0.99  # cosine between the axis of a cylinder that stands on its end and the vertical
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Support:
    """The support of an object at one instant.

    Attributes:
        bodies: the supporting bodies.
        gap: distance to the nearest other body, m.
        inside: distance of the centre of mass from the edge of the support region in the horizontal plane, m; negative
            outside.
        stays: whether contact forces keep the object where it is; None if the support region alone decides.
        region: (n, 2) corners of the support patches in the horizontal plane; None without support.
    """

    bodies: frozenset[str]
    gap: float
    inside: float
    stays: bool | None = None
    region: np.ndarray | None = field(default=None, compare=False, repr=False)

    @property
    def stable(self) -> bool:
        """Whether the object is supported with the stability margin ``limits.STABLE_MARGIN``, or stays by friction."""
        if self.stays is not None:
            return self.stays
        return bool(self.bodies) and self.inside >= limits.STABLE_MARGIN


def overlap(a: Polytope, b: Polytope) -> np.ndarray | None:
    """Corners (k, 3) of the intersection of two polytopes; None if it is empty."""
    if _separated_by_face(a.points, b.faces) or _separated_by_face(b.points, a.faces):
        return None
    rows = np.vstack([a.faces, b.faces])
    center = _sampled_interior(a, b)
    if center is None:
        center = _center(rows)
    try:
        return None if center is None else HalfspaceIntersection(rows, center).intersections
    except QhullError:
        return None


def _depth(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Depth (n,) of points (n, 3) inside halfspaces (m, 4), m; negative outside."""
    return -(points @ rows[:, :3].T + rows[:, 3]).max(axis=1)


def _separated_by_face(points: np.ndarray, rows: np.ndarray) -> bool:
    """Whether a halfspace (m, 4) excludes every ball of radius ``MIN_RADIUS`` in the hull of points (n, 3)."""
    return bool(np.any((points @ rows[:, :3].T + rows[:, 3]).min(axis=0) > -2.0 * MIN_RADIUS))


def _sampled_interior(a: Polytope, b: Polytope) -> np.ndarray | None:
    """A point (3,) at least ``SAMPLED_DEPTH`` inside two polytopes, by sampling; None if no sample qualifies.

    The samples lie between the mean of the corners that one has inside the other and the centre of the first one. This
    finds a point if one body stands on the other.
    """
    corners = np.vstack([a.points[_depth(b.faces, a.points) >= 0.0], b.points[_depth(a.faces, b.points) >= 0.0]])
    if len(corners) == 0:
        return None
    begin = corners.mean(axis=0)
    points = begin + CENTER_FRACTIONS[:, None] * (a.points.mean(axis=0) - begin)
    depth = np.minimum(_depth(a.faces, points), _depth(b.faces, points))
    return points[depth.argmax()] if depth.max() >= SAMPLED_DEPTH else None


def _center(rows: np.ndarray) -> np.ndarray | None:
    """Chebyshev centre (3,) of halfspaces (m, 4); None if its radius is below ``MIN_RADIUS``."""
    # maximise r with normal @ x + r + offset <= 0
    bounds = [(None, None)] * 3 + [(0.0, None)]
    table = np.column_stack([rows[:, :3], np.ones(len(rows))])
    lp = scipy.optimize.linprog([0, 0, 0, -1], A_ub=table, b_ub=-rows[:, 3], bounds=bounds)
    return lp.x[:3] if lp.success and lp.x[3] >= MIN_RADIUS else None


def inside(points: np.ndarray, center: np.ndarray) -> float:
    """Distance of a point (2,) from the edge of the hull of points (n, 2), m; negative outside."""
    try:
        equations = ConvexHull(points).equations
    except QhullError:  # a point or a line is no support region
        return -float(np.linalg.norm(points - center, axis=1).min())
    return -float(np.max(equations[:, :2] @ center + equations[:, 2]))


def center_of_mass(world: World, name: str, k: int) -> np.ndarray:
    """Centre of mass (3,) of a body of uniform density at sample k, world frame."""
    parts = world.parts_of(name)
    volumes = np.array([part.solid.volume for part in parts])
    tracks = [world.tracks[part] for part in parts]
    centers = np.array([t.R[k] @ t.part.solid.centroid + t.p[k] for t in tracks])
    return volumes @ centers / volumes.sum()


def lowest_points(world: World, name: str, window: slice) -> np.ndarray:
    """Height (n,) of an object's lowest point at some samples, m."""
    parts = world.parts_of(name)
    points = np.concatenate([part.solid.points @ part.R.T + part.p for part in parts])
    balls = np.repeat([part.solid.ball for part in parts], [len(part.solid.points) for part in parts])
    R, p = (values[window] for values in world.state.bodies[name])
    lowest = [(points @ row - balls).min() for row in R[:, 2]]
    return np.array(lowest) + p[:, 2]


class SupportFinder:
    """Finds the supports of the bodies of a world."""

    def __init__(self, world: World):
        self._world = world
        # most bodies are at rest most of the time
        self._contacts: dict[tuple, tuple[float, np.ndarray | None]] = {}
        self._supports: dict[tuple, tuple[Support, bool]] = {}
        self._stays: dict[tuple, bool] = {}
        self._numbers: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def at(self, name: str, k: int, released: bool = False) -> Support:
        """The support of a body at sample k; one that was ``released`` there must not roll away either."""
        self._world.check_time()
        near = self._nearest_pairs(name, k, limits.SUPPORT_GAP)
        key = (name, *(self._key(part, other, k) for part, other in near))
        if key not in self._supports:
            self._supports[key] = self._support(name, near, k)
        support, rolls = self._supports[key]
        if support.gap <= limits.SUPPORT_GAP and (not support.stable or (released and rolls)):
            return replace(support, stays=self._at_rest(name, k))
        return support

    def _support(self, name: str, near: list[tuple[Part, Part]], k: int) -> tuple[Support, bool]:
        """The support of a body by near pairs of parts, without the forces, and whether it lies on a round side."""
        carriers, patches, gap = set(), [], np.inf
        rolls = False
        for part, other in near:
            distance, patch = self._contact(part, other, k)
            gap = min(gap, distance)
            if patch is not None:
                carriers.add(other.holder)
                patches.append(patch[:, :2])
                rolls |= self._round(part, k)
        region = np.vstack(patches) if patches else None
        depth = inside(region, center_of_mass(self._world, name, k)[:2]) if region is not None else -np.inf
        return Support(frozenset(carriers), gap, depth, region=region), rolls

    def _at_rest(self, name: str, k: int) -> bool:
        """Whether the forces of all that is near keep a body where it is."""
        near = self._nearest_pairs(name, k, NEARBY)
        beside = [(part, other) for part, other in near if self._contact(part, other, k)[0] <= NEARBY]
        key = (name, *(self._key(part, other, k) for part, other in beside))
        if key not in self._stays:
            others = list(dict.fromkeys(other for _, other in beside))
            self._stays[key] = rest.stays(self._world, name, others, center_of_mass(self._world, name, k), k)
        return self._stays[key]

    def _nearest_pairs(self, name: str, k: int, reach: float) -> list[tuple[Part, Part]]:
        """The parts of a body with those of other bodies: all that are nearer than ``reach`` (m), and the nearest one.

        Distances of bounding boxes tell which can be left out.
        """
        parts = self._world.parts
        if name not in self._numbers:
            bodies = [i for i, part in enumerate(parts) if part.link is None]
            of_body = np.array([parts[i].holder == name for i in bodies], bool)
            self._numbers[name] = np.array(bodies, int)[of_body], np.array(bodies, int)[~of_body]
        best, found = np.inf, []
        for bound, (i, j) in nearest_first(self._world, *self._numbers[name], k):
            if bound > max(best, reach):
                break
            best = min(best, self._contact(parts[i], parts[j], k)[0])
            found.append((i, j))
        return [(parts[i], parts[j]) for i, j in sorted(found)]

    def _round(self, part: Part, k: int) -> bool:
        """Whether a part lies on a round side."""
        upright = abs(self._world.tracks[part].R[k][2, 2]) > UPRIGHT
        return part.solid.kind in ("sphere", "capsule") or (part.solid.kind == "cylinder" and not upright)

    def _key(self, part: Part, other: Part, k: int) -> tuple[Part, Part, bytes, bytes]:
        """Two parts, and where they are at sample k."""
        poses = self._world.poses
        return part, other, poses[part.holder][k].tobytes(), poses[other.holder][k].tobytes()

    def _contact(self, part: Part, other: Part, k: int) -> tuple[float, np.ndarray | None]:
        """Distance (m) of two parts, and the corners (n, 3) of the patch where ``other`` supports ``part``, or None."""
        key = self._key(part, other, k)
        if key not in self._contacts:
            self._contacts[key] = self._measured(part, other, k)
        return self._contacts[key]

    def _measured(self, part: Part, other: Part, k: int) -> tuple[float, np.ndarray | None]:
        a, b = self._world.tracks[part], self._world.tracks[other]
        gauge = self._world.gauge(part, other)
        distance = gauge.distance(a.at(k), b.at(k))
        if distance > limits.SUPPORT_GAP:
            return distance, None
        raised = transform(a.R[k], a.p[k] - limits.GRAVITY_SLIDE * DOWN)
        if gauge.distance(raised, b.at(k)) <= MIN_RADIUS:
            return distance, None
        lowered = Polytope.around(part.solid, a.R[k], a.p[k] + limits.SUPPORT_GAP * DOWN)
        return distance, overlap(lowered, Polytope.around(other.solid, b.R[k], b.p[k]))


def moved(world: World, name: str, k: int) -> bool:
    """Whether a body is elsewhere at sample k than at the start of the plan."""
    distance, angle = deviation(world.poses[name][k : k + 1], world.document.bodies[name].pose)
    return bool(distance[0] > limits.UNTOUCHED_POSITION or angle[0] > limits.UNTOUCHED_ROTATION)


def _report(support: Support, name: str, time: float, findings: Findings) -> None:
    if support.stable:
        return
    if not support.bodies:
        amount, limit = support.gap, limits.SUPPORT_GAP
        findings.add(Kind.UNSUPPORTED, (name,), time, amount, limit, amount)
    elif support.inside >= limits.STABLE_MARGIN:
        bodies = (name, *sorted(support.bodies))
        findings.add(Kind.UNSUPPORTED, bodies, time, limits.ROLL_ROOM, 0.0, limits.ROLL_ROOM)
    else:
        bodies = (name, *sorted(support.bodies))
        findings.add(Kind.UNSUPPORTED, bodies, time, -support.inside, -limits.STABLE_MARGIN, -support.inside)


def travelled(world: World, contact: Contact) -> list[int]:
    """Samples of a push or press at which the support is checked: every ``SUPPORT_CHECK_STEP``, and the end."""
    poses = world.poses[contact.object][contact.window]
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))])
    marks = np.arange(0.0, travel[-1], limits.SUPPORT_CHECK_STEP)
    return sorted({contact.segment.first + int(i) for i in (*np.searchsorted(travel, marks), len(travel) - 1)})


class SupportCheck:
    """Reports objects without stable support, and collects the pairs of objects and supports.

    Attributes:
        pairs: an object and a body that supports it at some time, for each such pair.
        finder: finds the supports.
    """

    def __init__(self, world: World, contacts: list[Contact], findings: Findings):
        self._world = world
        self._contacts = contacts
        self._findings = findings
        self.finder = SupportFinder(world)
        self.pairs: set[frozenset[str]] = set()

    def run(self) -> None:
        """Checks every object while no contact moves it; in physical mode also during pushes and presses."""
        names = [name for name, body in self._world.document.bodies.items() if not body.fixed]
        for name in names:
            self._check_free(name)
        if self._world.document.mode == "physical":
            for contact in self._contacts:
                if contact.kind in ("push", "press"):
                    self._check_pushed(contact)

    def _find(self, name: str, k: int, released: bool = False) -> Support:
        support = self.finder.at(name, k, released)
        self.pairs |= {frozenset((name, body)) for body in support.bodies}
        return support

    def _check_free(self, name: str) -> None:
        """Checks an object that the plan has placed, or whose support the plan has removed."""
        stable_before = self._find(name, 0).stable
        free = np.ones(self._world.samples - 1, bool)
        for contact in self._contacts:
            if contact.object == name:
                free[contact.segment.first : contact.segment.last] = False
        for first, last in runs(free):
            for k in self._changes(first, last):
                elsewhere = moved(self._world, name, k)
                if stable_before or elsewhere:
                    support = self._find(name, k, elsewhere and self._world.document.mode == "physical")
                    _report(support, name, self._world.document.time[k], self._findings)

    def _changes(self, first: int, last: int) -> list[int]:
        """The ends of an interval and the ends of segments inside it, when other bodies may have moved."""
        ends = {k for s in self._world.document.segments for k in (s.first, s.last) if first < k < last}
        return sorted({first, last} | ends)

    def _check_pushed(self, contact: Contact) -> None:
        """Checks that the scene, and not the robot, supports a pushed object."""
        for k in travelled(self._world, contact):
            _report(self._find(contact.object, k), contact.object, self._world.document.time[k], self._findings)
