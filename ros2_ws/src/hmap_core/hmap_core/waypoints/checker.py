"""Exact collision and support checks of one body at a pose and along a motion."""

import math
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from hmap_core import clock
from hmap_core.collision.bvh import Tree, build_tree
from hmap_core.collision.convex import ConvexSet
from hmap_core.exceptions import Code, InputError
from hmap_core.komo.shapes import body_set
from hmap_core.transforms import apply, inverse, multiply, pose, rotation_matrix
from hmap_core.types import Body
from hmap_core.waypoints import kernels, tree_kernels
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.support import Support, feet

# m; deeper penetration at the start or the goal is an error; the judge of plans allows the same
PENETRATION_ALLOWED = 1e-3
# a shape with its top at most this far above the body's lowest point carries the body and is no obstacle, m
SUPPORT_TOLERANCE = 1e-3
# rounding error of a distance, m: a pair that touches at the start can come nearer by this
CONTACT_SLACK = 1e-5
# distances are computed up to this, m
CLEARANCE_CAP = 0.25
# pairs of shapes from which on trees find the near ones; for fewer, all pairs are compared
MANY_PAIRS = 64
# shapes of a body from which on all its vertices are moved at once
_MANY_SHAPES = 32
# a distance beyond the minimum distance that the ends' distances need to be known up to, m
_END_RANGE = 0.02
# frames with a smaller distance are the same, m
SAME_PLACE = 1e-9
# arrays of a body without support
_NO_SUPPORT = (
    np.zeros(7), 0.0, np.zeros(2), np.zeros((0, 2)), np.zeros(1, np.int64), np.zeros((0, 2)), np.zeros(1, np.int64),
    np.zeros((0, 2)), np.zeros((0, 4)),
)  # fmt: skip
_NO_TREES = (build_tree(np.zeros((0, 3)), np.zeros((0, 3))),) * 2


class ObstacleShapes:
    """Convex shapes of the fixed obstacles in the world frame, and the names of their bodies.

    Attributes:
        hulls: for each of the SB shapes its vertices (n, 3) in m, and the radius in m of the sphere swept over its
            hull.
        owner: the name of each shape's body.
        lower: (SB, 3) lower corners of the axis-aligned bounding boxes, m.
        upper: (SB, 3) upper corners, m.
    """

    def __init__(self, hulls: list[tuple[np.ndarray, float]], owner: list[str]):
        self.hulls, self.owner = hulls, owner
        self.vertices = np.ascontiguousarray(np.concatenate([h for h, _ in hulls])) if hulls else np.zeros((0, 3))
        self.start = np.concatenate([[0], np.cumsum([len(h) for h, _ in hulls])]).astype(np.int64)
        self.radius = np.array([r for _, r in hulls], float)
        self.lower, self.upper = _boxes(self.vertices, self.start, self.radius)
        self.arrays = (self.vertices, self.start, self.radius, self.lower, self.upper)

    @cached_property
    def tree(self) -> Tree:
        """The tree of their bounding boxes."""
        return build_tree(self.lower, self.upper)

    @classmethod
    def of(cls, bodies: tuple[Body, ...]) -> "ObstacleShapes":
        """The shapes of bodies at their poses."""
        hulls: list[tuple[np.ndarray, float]] = []
        owner: list[str] = []
        for body in bodies:
            own = body_set(body)
            if len(own) < _MANY_SHAPES:
                placed = [apply(body.pose, own.hull(k)) for k in range(len(own))]
            else:
                placed = np.split(apply(body.pose, own.vertices), own.start[1:-1])
            hulls += zip(placed, own.radius.tolist(), strict=True)
            owner += [body.name] * len(own)
        return cls(hulls, owner)

    def kept(self, keep: np.ndarray) -> "ObstacleShapes":
        """The shapes for which ``keep`` (SB,) is true."""
        if keep.all():
            return self
        chosen = np.flatnonzero(keep)
        return ObstacleShapes([self.hulls[k] for k in chosen], [self.owner[k] for k in chosen])


def _boxes(vertices: np.ndarray, start: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners (S, 3) of the bounding boxes of swept hulls, given as in a ``ConvexSet``."""
    if len(radius) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    lower, upper = (f.reduceat(vertices, start[:-1]) for f in (np.minimum, np.maximum))
    return lower - radius[:, None], upper + radius[:, None]


class Geometry:
    """The shapes of a problem: the body's in its own frame, the obstacles' in the world frame.

    Args:
        problem: the problem.
        obstacles: the shapes of its obstacles, if they are known.
        deadline: when checks end, in seconds of ``clock.now``; what was not checked in time counts as blocked.
    """

    def __init__(self, problem: ObjectPathProblem, obstacles: ObstacleShapes | None = None, deadline: float = math.inf):
        self.body: ConvexSet = body_set(problem.body)
        self.body_arrays = (
            self.body.vertices, self.body.start, self.body.radius, self.body.center, self.body.bound,
        )  # fmt: skip
        self.obstacles = ObstacleShapes.of(problem.obstacles) if obstacles is None else obstacles
        self.deadline = deadline

    @cached_property
    def body_tree(self) -> Tree:
        """The tree of the bounding boxes of the body's shapes, in its frame."""
        return build_tree(*_boxes(self.body.vertices, self.body.start, self.body.radius))

    def many(self, obstacles: ObstacleShapes) -> bool:
        """Whether the body and some obstacle shapes have so many pairs that checks use trees."""
        return len(self.body) * len(obstacles.radius) > MANY_PAIRS

    def distances(self, T: np.ndarray, obstacles: ObstacleShapes, cap: float, deadline: float = math.inf) -> np.ndarray:
        """Signed distances (SB,) in m from the body at pose T (7,) to obstacle shapes, at most ``cap``.

        After the deadline (s) they are ``-inf``.
        """
        out = np.empty(len(obstacles.radius))
        T = np.asarray(T, float)
        if not self.many(obstacles):
            kernels.distances(T, *self.body_arrays, *obstacles.arrays, cap, out)
        elif not tree_kernels.distances(
            T, (*self.body_arrays, *obstacles.arrays), (self.body_tree, obstacles.tree), cap, out, deadline,
            tree_kernels.new_scratch(),
        ):  # fmt: skip
            out[:] = -math.inf
        return out


class ObjectChecker:
    """Exact checks of one body among fixed obstacles.

    The required distance to a shape is ``min_distance``. It is less if the body is nearer to the shape at its start or
    goal already (a book between books, an object on its table). In planar motion the shapes below the body carry it and
    are no obstacles; the centre of mass then has to stay above them.

    Args:
        problem: the body, its start and goal.
        geometry: the shapes of ``problem``.
        planar: check planar motion; otherwise motion in SE(3).
        min_distance: m.
    """

    def __init__(self, problem: ObjectPathProblem, geometry: Geometry, planar: bool, min_distance: float):
        self.planar = planar
        self.level = planar or problem.level  # whether motions turn about the vertical only
        self.body = geometry.body
        reach = np.maximum.reduceat(np.linalg.norm(self.body.vertices, axis=1), self.body.start[:-1])
        self.radius = float((reach + self.body.radius).max())  # m, of the body about the origin of its frame
        self._geometry = geometry
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
            if support.is_stable(problem.start) and support.is_stable(problem.goal):
                self.support = support
            shapes = everything.kept(~below)
        self.obstacles = shapes
        self._b = shapes.arrays
        many = geometry.many(shapes)
        self._trees = (geometry.body_tree, shapes.tree) if many else _NO_TREES
        self._scratch = tree_kernels.new_scratch() if many else None
        self._range = min(CLEARANCE_CAP, min_distance + _END_RANGE) if many else CLEARANCE_CAP
        self._ends = np.array([geometry.distances(T, shapes, self._range) for T in (problem.start, problem.goal)])
        self._no_extra = np.zeros(len(self.owners))
        self.checks = 0  # number of checked motions
        self._keep(min_distance)
        if many:
            self.hit_by(problem.start, problem.start)  # loads its compiled code, for which the end has no time

    def _keep(self, min_distance: float) -> None:
        self.min_distance = min_distance
        self.contact_at_end = self._ends < min_distance  # (2, SB) within min_distance at the start, at the goal
        self.contact = np.asarray(self.contact_at_end.any(axis=0))
        self.required = np.maximum(
            np.minimum(min_distance, self._ends.min(axis=0) - CONTACT_SLACK), -PENETRATION_ALLOWED
        )
        self.blocked = np.zeros(len(self.owners), np.int64)  # number of motions that each shape has blocked

    def with_min_distance(self, min_distance: float) -> "ObjectChecker":
        """The same checker with another minimum distance in metres."""
        other = copy(self)
        other._keep(min_distance)
        return other

    @property
    def arrays(self) -> tuple:
        """The arguments of the compiled searches: shapes, trees, required and extra distances, support, ``blocked``.

        The trees have no nodes if there are few pairs. The last one is the deadline.
        """
        support = _NO_SUPPORT if self.support is None else self.support.arrays
        held = (self.support is not None, *support)
        return self._shapes, self._trees, self.required, self._no_extra, held, self.blocked, self._geometry.deadline

    @property
    def deadline(self) -> float:
        """When checks end, in seconds of ``clock.now``; motions that were not checked in time count as blocked."""
        return self._geometry.deadline

    @property
    def late(self) -> bool:
        """Whether the deadline is over."""
        return self.deadline < math.inf and clock.now() >= self.deadline

    def allow_until(self, deadline: float) -> None:
        """Move the deadline to a later one, in seconds of ``clock.now``."""
        self._geometry.deadline = max(self._geometry.deadline, deadline)

    def end_by(self, deadline: float) -> None:
        """Move the deadline to an earlier one, in seconds of ``clock.now``."""
        self._geometry.deadline = min(self._geometry.deadline, deadline)

    @property
    def _shapes(self) -> tuple:
        return (*self._a, *self._b)

    @property
    def owners(self) -> list[str]:
        """The name of each obstacle shape's body, (SB,)."""
        return self.obstacles.owner

    def distances(self, T: np.ndarray) -> np.ndarray:
        """Signed distances (SB,) in m from the body at pose T (7,) to the obstacle shapes.

        They are capped, at CLEARANCE_CAP, or sooner if there are many pairs; after the deadline they are ``-inf``.
        """
        return self._geometry.distances(T, self.obstacles, self._range, self._geometry.deadline)

    def clearances(self, poses: np.ndarray) -> np.ndarray:
        """Distances (M,) in m at poses (M, 7) to the shapes not touched at start or goal; at most CLEARANCE_CAP.

        Among many pairs, poses that come after the deadline have the minimum distance.
        """
        if self._scratch is None:
            return kernels.clearances(poses, *self._a, *self._b, ~self.contact, CLEARANCE_CAP)
        return tree_kernels.clearances(
            poses, self._shapes, self._trees, ~self.contact, CLEARANCE_CAP, self.min_distance,
            self.deadline, self._scratch,
        )  # fmt: skip

    def pose_free(self, T: np.ndarray) -> bool:
        """Whether the body at pose T (7,) is free of collisions and supported."""
        if self._blocking(np.asarray(T, float)) != -1:
            return False
        return self.support is None or self.support.is_stable(T)

    def _blocking(self, T: np.ndarray) -> int:
        if self._scratch is None:
            return kernels.blocking(T, *self._a, *self._b, self.required, self._no_extra)
        return tree_kernels.blocking(
            T, self._shapes, self._trees, self.required, self._no_extra, self.deadline, self._scratch
        )

    def _free_until(self, T0: np.ndarray, T1: np.ndarray, extra: np.ndarray, hit: np.ndarray) -> float:
        if self._scratch is None:
            return kernels.free_until(T0, T1, *self._a, *self._b, self.required, extra, hit)
        return tree_kernels.free_until(
            T0, T1, self._shapes, self._trees, self.required, extra, hit, self.deadline, self._scratch
        )

    def motion_free(self, T0: np.ndarray, T1: np.ndarray, extra: float = 0.0, near: np.ndarray | None = None) -> bool:
        """Check the motion from T0 to T1.

        Args:
            T0: T_world_obj (7,).
            T1: T_world_obj (7,).
            extra: distance in m that is required beyond the minimum distance.
            near: (SB,) shapes for which the required distance is that at start or goal, without ``extra``; None: all
                shapes that the body touches at start or goal.

        Returns:
            Whether the whole motion is free of collisions and supported.
        """
        self.checks += 1
        hit = np.array([-1, 0])
        more = self._no_extra
        if extra or near is not None:
            more = np.where(self.contact if near is None else near, 0.0, self.min_distance + extra - self.required)
        if self._free_until(T0, T1, more, hit) < 1.0:
            if hit[0] >= 0:
                self.blocked[hit[0]] += 1
            return False
        return self.supported_along(T0, T1)

    def supported_along(self, T0: np.ndarray, T1: np.ndarray) -> bool:
        """Whether the body stays on its support along the motion from T0 to T1 (7,); true if it needs none.

        After the deadline a body that needs support counts as falling.
        """
        return self.support is None or (not self.late and self.support.is_stable_along(T0, T1))

    def free_part(self, T0: np.ndarray, T1: np.ndarray) -> float:
        """Parameter in [0, 1] up to which the motion from T0 to T1 (7,) is free of collisions; ignores the support."""
        self.checks += 1
        return float(self._free_until(T0, T1, self._no_extra, np.array([-1, 1])))

    def hit_by(self, T0: np.ndarray, T1: np.ndarray) -> list[str]:
        """Names of the bodies that the motion from T0 to T1 (7,) collides with, without repetition.

        Among many pairs those that are found before the deadline.
        """
        names: list[str] = []
        if self._scratch is not None:
            hits = np.zeros(len(self.owners), bool)
            tree_kernels.hits_along(
                T0, T1, self._shapes, self._trees, self.required, self._no_extra, hits, self._geometry.deadline,
                self._scratch,
            )  # fmt: skip
            return list(dict.fromkeys(self.owners[j] for j in np.flatnonzero(hits)))
        for j, name in enumerate(self.owners):
            need = np.full(len(self.required), -np.inf)
            need[j] = self.required[j]
            free = kernels.free_until(T0, T1, *self._a, *self._b, need, self._no_extra, np.array([-1, 0]))
            if free < 1.0 and name not in names:
                names.append(name)
        return names


def body_middle(body: Body) -> np.ndarray:
    """Centre (3,) of the bounding box of the body's largest shape, in m, body frame. Motions turn about this point."""
    own = body_set(body)
    hulls = [(own.hull(k), own.radius[k]) for k in range(len(own))]
    largest = max(hulls, key=lambda hull: np.linalg.norm(np.ptp(hull[0], axis=0) + 2.0 * hull[1]))[0]
    middle = 0.5 * (largest.min(axis=0) + largest.max(axis=0))
    return middle if np.abs(middle).max() > SAME_PLACE else np.zeros(3)


def recentred(problem: ObjectPathProblem, middle: np.ndarray) -> ObjectPathProblem:
    """The same problem with the body's frame moved to ``middle`` (3,), so that its motions turn about this point."""
    if not middle.any():
        return problem
    shift = pose(-middle)
    shapes = tuple(replace(shape, pose=multiply(shift, shape.pose)) for shape in problem.body.shapes)
    start, goal = (multiply(T, pose(middle)) for T in (problem.start, problem.goal))
    return replace(problem, body=replace(problem.body, shapes=shapes), start=start, goal=goal)


def check_ends(problem: ObjectPathProblem, obstacles: ObstacleShapes | None = None) -> frozenset[str]:
    """Check start and goal for penetration.

    Args:
        problem: the problem.
        obstacles: the shapes of its obstacles, if they are known.

    Returns:
        Removable bodies that the body penetrates at its goal by more than PENETRATION_ALLOWED.

    Raises:
        InputError: START_IN_COLLISION if the body penetrates any obstacle at its start by more than that;
            GOAL_IN_COLLISION if it penetrates an obstacle that is not removable at its goal.
    """
    geometry = Geometry(problem, obstacles)
    shapes = geometry.obstacles
    taken: set[str] = set()
    for name, T, code in (
        ("start", problem.start, Code.START_IN_COLLISION),
        ("goal", problem.goal, Code.GOAL_IN_COLLISION),
    ):
        out = geometry.distances(T, shapes, 0.0)
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


def planar_projection(problem: ObjectPathProblem, T: np.ndarray) -> np.ndarray:
    """The pose (7,) nearest to T (7,) that planar motion from the start can reach."""
    return planar_pose(problem.start, T[0], T[1], planar_yaw(problem.start, T))


def planar_yaw(start: np.ndarray, T: np.ndarray) -> float:
    """Rotation in rad of pose T (7,) relative to ``start`` (7,) about the vertical axis."""
    q = multiply(np.r_[np.zeros(3), T[3:]], inverse(np.r_[np.zeros(3), start[3:]]))[3:]
    return 2.0 * float(np.arctan2(q[2], q[3]))


def planar_pose(start: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    """The pose (7,) at x, y (m) and the height of ``start`` (7,), rotated from it by ``yaw`` (rad) about the
    vertical.
    """
    s, c = math.sin(yaw / 2), math.cos(yaw / 2)
    qx, qy, qz, qw = start[3:].tolist()
    return np.array([x, y, start[2], c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz])
