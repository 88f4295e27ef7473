"""Whether a body may stand at a pose and move between two: collision and support together."""

import math
from copy import copy
from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import ConvexSet, hull_vertices
from hmap_core.exceptions import Code, InputError
from hmap_core.komo.shapes import body_set
from hmap_core.transforms import apply, inverse, multiply, pose, rotation_matrix
from hmap_core.types import Body
from hmap_core.waypoints import kernels
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.support import Support, feet

# what the judge of plans allows, m: deeper at the start or the goal is refused
PENETRATION_ALLOWED = 1e-3
# a shape whose top is no more than this above the body's lowest point carries it and is not in its way, m
SUPPORT_TOLERANCE = 1e-3
# rounding in a distance, m: a pair that touches at the start may come nearer by this
CONTACT_SLACK = 1e-5
# distances beyond this do not matter, m
CLEARANCE_CAP = 0.25
# frames nearer than this are one, m
SAME_PLACE = 1e-9
# stands in for the arrays of a support where there is none
_NO_SUPPORT = (
    np.zeros(7), 0.0, np.zeros(2), np.zeros((0, 2)), np.zeros(1, np.int64), np.zeros((0, 2)), np.zeros(1, np.int64),
)  # fmt: skip


class ObstacleShapes:
    """Convex shapes that stand still, in the world frame, and whose they are.

    Attributes:
        hulls: per shape its vertices (n, 3) and the radius of the sphere that sweeps them.
        owner: per shape the name of its body.
        lower, upper: (SB, 3) axis-aligned bounds.
    """

    def __init__(self, hulls: list[tuple[np.ndarray, float]], owner: list[str]):
        self.hulls, self.owner = hulls, owner
        self.vertices = np.ascontiguousarray(np.concatenate([h for h, _ in hulls])) if hulls else np.zeros((0, 3))
        self.start = np.concatenate([[0], np.cumsum([len(h) for h, _ in hulls])]).astype(np.int64)
        self.radius = np.array([r for _, r in hulls])
        self.lower = np.array([h.min(0) - r for h, r in hulls]).reshape(-1, 3)
        self.upper = np.array([h.max(0) + r for h, r in hulls]).reshape(-1, 3)
        self.arrays = (self.vertices, self.start, self.radius, self.lower, self.upper)

    @classmethod
    def of(cls, bodies: tuple[Body, ...]) -> "ObstacleShapes":
        """The shapes of bodies at their poses."""
        hulls, owner = [], []
        for body in bodies:
            for shape in body.shapes:
                vertices, radius = hull_vertices(shape)
                hulls.append((apply(body.pose, vertices), radius))
                owner.append(body.name)
        return cls(hulls, owner)

    def kept(self, keep: np.ndarray) -> "ObstacleShapes":
        """Only the shapes where ``keep`` (SB,) is true."""
        chosen = np.flatnonzero(keep)
        return ObstacleShapes([self.hulls[k] for k in chosen], [self.owner[k] for k in chosen])


class Geometry:
    """The shapes of a problem: the body's in its own frame, the obstacles' in the world frame."""

    def __init__(self, problem: ObjectPathProblem):
        self.body: ConvexSet = body_set(problem.body)
        self.body_arrays = (
            self.body.vertices, self.body.start, self.body.radius, self.body.center, self.body.bound,
        )  # fmt: skip
        self.obstacles = ObstacleShapes.of(problem.obstacles)


class ObjectChecker:
    """Exact checks of one body among obstacles that stand still.

    Required distance: the min_distance, or less for a shape that the body is nearer to at its start or goal already
        (a book
    between books, an object on its table). In planar motion the shapes that lie below the body carry it and are
    not obstacles; its centre of mass then has to stay over them.
    """

    def __init__(self, problem: ObjectPathProblem, geometry: Geometry, planar: bool, min_distance: float):
        self.planar = planar
        self.body = geometry.body
        reach = [np.linalg.norm(self.body.hull(k), axis=1).max() + self.body.radius[k] for k in range(len(self.body))]
        self.radius = float(max(reach))  # m, of the body about the origin of its frame
        self._a = geometry.body_arrays
        everything = geometry.obstacles
        self.support = None
        shapes = everything
        if planar:
            lowest = feet(self.body, rotation_matrix(problem.start))[1] + float(problem.start[2])
            below = everything.upper[:, 2] <= lowest + SUPPORT_TOLERANCE
            carrying = below & (everything.upper[:, 2] >= lowest - SUPPORT_TOLERANCE)
            carriers = [everything.hulls[k] for k in np.flatnonzero(carrying)]
            support = Support(self.body, carriers, problem.start)
            if support.holds(problem.start) and support.holds(problem.goal):
                self.support = support
            shapes = everything.kept(~below)
        self.obstacles = shapes
        self._b = shapes.arrays
        self._ends = np.array([self.distances(problem.start), self.distances(problem.goal)])
        self._no_extra = np.zeros(len(self.owners))
        self.checks = 0  # motions looked at
        self._keep(min_distance)

    def _keep(self, min_distance: float) -> None:
        self.min_distance = min_distance
        self.contact_at_end = self._ends < min_distance  # (2, SB) touched, or nearly, at the start and at the goal
        self.contact = self.contact_at_end.any(axis=0)
        self.required = np.maximum(
            np.minimum(min_distance, self._ends.min(axis=0) - CONTACT_SLACK), -PENETRATION_ALLOWED
        )
        self.blocked = np.zeros(len(self.owners), np.int64)  # how often each shape stopped a motion

    def with_margin(self, min_distance: float) -> "ObjectChecker":
        """The same checker with another minimum distance in metres."""
        other = copy(self)
        other._keep(min_distance)
        return other

    @property
    def arrays(self) -> tuple:
        """What compiled searches have to know: shapes, required and extra distances, support, ``blocked``."""
        support = _NO_SUPPORT if self.support is None else self.support.arrays
        return (*self._a, *self._b), self.required, self._no_extra, (self.support is not None, *support), self.blocked

    @property
    def owners(self) -> list[str]:
        """Name of the body of each obstacle shape, (SB,)."""
        return self.obstacles.owner

    def distances(self, T: np.ndarray, cap: float = CLEARANCE_CAP) -> np.ndarray:
        """Signed distances (SB,) in metres at pose T (7,) to the obstacle shapes, at most ``cap``."""
        out = np.empty(len(self.obstacles.radius))
        kernels.distances(np.asarray(T, float), *self._a, *self._b, cap, out)
        return out

    def clearances(self, poses: np.ndarray) -> np.ndarray:
        """Distances (M,) in metres at poses (M, 7) to what is not touched at an end, at most CLEARANCE_CAP."""
        return kernels.clearances(poses, *self._a, *self._b, ~self.contact, CLEARANCE_CAP)

    def pose_free(self, T: np.ndarray) -> bool:
        """Whether the body may stand at pose T (7,)."""
        if kernels.blocking(T, *self._a, *self._b, self.required, self._no_extra) >= 0:
            return False
        return self.support is None or self.support.holds(T)

    def motion_free(self, T0: np.ndarray, T1: np.ndarray, extra: float = 0.0, near: np.ndarray | None = None) -> bool:
        """Whether the body may move from T0 to T1 (7,), ``extra`` metres more than the minimum distance off what is
        not ``near``.

        ``near`` (SB,) are the shapes that it may come as near to as at an end; None: all contacts.
        """
        self.checks += 1
        hit = np.array([-1, 0])
        more = self._no_extra
        if extra or near is not None:
            more = np.where(self.contact if near is None else near, 0.0, self.min_distance + extra - self.required)
        if kernels.free_until(T0, T1, *self._a, *self._b, self.required, more, hit) < 1.0:
            self.blocked[hit[0]] += 1
            return False
        return self.supported_along(T0, T1)

    def supported_along(self, T0: np.ndarray, T1: np.ndarray) -> bool:
        """Whether the body stays on its support, where it has to, all the way from T0 to T1."""
        return self.support is None or self.support.holds_along(T0, T1)

    def free_part(self, T0: np.ndarray, T1: np.ndarray) -> float:
        """Parameter in [0, 1] up to which the motion from T0 to T1 touches nothing; support is not looked at."""
        self.checks += 1
        return float(kernels.free_until(T0, T1, *self._a, *self._b, self.required, self._no_extra, np.array([-1, 1])))

    def hit_by(self, T0: np.ndarray, T1: np.ndarray) -> list[str]:
        """Names of the bodies that the motion from T0 to T1 runs into, without repetition."""
        names = []
        for j, name in enumerate(self.owners):
            need = np.full(len(self.required), -np.inf)
            need[j] = self.required[j]
            free = kernels.free_until(T0, T1, *self._a, *self._b, need, self._no_extra, np.array([-1, 0]))
            if free < 1.0 and name not in names:
                names.append(name)
        return names


def body_middle(body: Body) -> np.ndarray:
    """Centre (3,) of the bounds of the body's largest shape, body frame: what the body best turns about."""
    hulls = [hull_vertices(shape) for shape in body.shapes]
    largest = max(hulls, key=lambda hull: np.linalg.norm(np.ptp(hull[0], axis=0) + 2.0 * hull[1]))[0]
    middle = 0.5 * (largest.min(axis=0) + largest.max(axis=0))
    return middle if np.abs(middle).max() > SAME_PLACE else np.zeros(3)


def recentred(problem: ObjectPathProblem, middle: np.ndarray) -> ObjectPathProblem:
    """The same problem with the body's frame moved to ``middle`` (3,), about which its motions then turn."""
    if not middle.any():
        return problem
    shift = pose(-middle)
    shapes = tuple(replace(shape, pose=multiply(shift, shape.pose)) for shape in problem.body.shapes)
    start, goal = (multiply(T, pose(middle)) for T in (problem.start, problem.goal))
    return replace(problem, body=replace(problem.body, shapes=shapes), start=start, goal=goal)


def check_ends(problem: ObjectPathProblem) -> frozenset[str]:
    """Removable bodies that the body penetrates at its goal by more than PENETRATION_ALLOWED.

    Raises:
        InputError: START_IN_COLLISION or GOAL_IN_COLLISION when it penetrates others, or any at its start.
    """
    geometry = Geometry(problem)
    shapes = geometry.obstacles
    taken: set[str] = set()
    for name, T, code in (
        ("start", problem.start, Code.START_IN_COLLISION),
        ("goal", problem.goal, Code.GOAL_IN_COLLISION),
    ):
        out = np.empty(len(shapes.radius))
        kernels.distances(np.asarray(T, float), *geometry.body_arrays, *shapes.arrays, 0.0, out)
        deep: dict[str, float] = {}
        for owner, d in zip(shapes.owner, out, strict=True):
            if d < -PENETRATION_ALLOWED:
                deep[owner] = max(deep.get(owner, 0.0), -float(d))
        if code == Code.GOAL_IN_COLLISION:
            taken = {owner for owner in deep if owner in problem.removable}
            deep = {owner: depth for owner, depth in deep.items() if owner not in taken}
        if deep:
            what = ", ".join(f"'{n}' by {1e3 * d:.1f} mm" for n, d in sorted(deep.items(), key=lambda i: -i[1]))
            raise InputError(
                f"'{problem.body.name}' penetrates {what} at its {name}; "
                f"at most {1e3 * PENETRATION_ALLOWED:g} mm is allowed",
                code,
            )
    return frozenset(taken)


def flattened(problem: ObjectPathProblem, T: np.ndarray) -> np.ndarray:
    """The pose nearest to T (7,) that the start reaches by planar motion."""
    return planar_pose(problem.start, T[0], T[1], planar_yaw(problem.start, T))


def planar_yaw(start: np.ndarray, T: np.ndarray) -> float:
    """How far pose T (7,) is turned about the vertical from ``start`` (7,), rad."""
    q = multiply(np.r_[np.zeros(3), T[3:]], inverse(np.r_[np.zeros(3), start[3:]]))[3:]
    return 2.0 * float(np.arctan2(q[2], q[3]))


def planar_pose(start: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    """The pose (7,) at x, y that is turned from ``start`` by ``yaw`` about the vertical, at the height of ``start``."""
    s, c = math.sin(yaw / 2), math.cos(yaw / 2)
    qx, qy, qz, qw = start[3:].tolist()
    return np.array([x, y, start[2], c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz])
