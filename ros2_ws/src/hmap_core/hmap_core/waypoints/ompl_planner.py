"""The object's path by a planner of OMPL instead of hmap's own search: the same question, checks and answer."""

from functools import partial

import numpy as np

from hmap_core.transforms import wrapped
from hmap_core.waypoints.checker import ObjectChecker, planar_pose, planar_yaw
from hmap_core.waypoints.ompl_solver import Query, Space, box_bounds, known_planner, modules, seeded
from hmap_core.waypoints.plan import DEFAULT_TIME_LIMIT, plan_waypoints
from hmap_core.waypoints.problem import ObjectPath, ObjectPathProblem
from hmap_core.waypoints.rrt import TURN_WEIGHT
from hmap_core.waypoints.search import GROWTH, MotionSpace
from hmap_core.waypoints.search_budget import SearchBudget

# states and motions that a planner may check in its first round; anytime planners without an end use all of them
EVALUATIONS = 4000
# longest steps, in the rounds in turn, of planners that have one, as fractions of the space's extent; None: OMPL's own,
# mostly 0.2, which is too long for narrow passages in space
STEPS = (None, 0.05)
# paths with more corners are thinned before they are shortened, which looks at all pairs
MAX_CORNERS = 40


def plan_waypoints_ompl(
    name: str,
    problem: ObjectPathProblem,
    rng: np.random.Generator,
    time_limit_s: float = DEFAULT_TIME_LIMIT,
    checks: float = np.inf,
) -> ObjectPath:
    """Plan the object's own path as :func:`plan_waypoints` does, but search by a planner of OMPL.

    Args:
        name: class name of a geometric planner of OMPL, such as RRTConnect or BITstar.
        problem: the body, its start and goal, what stands around.
        rng: the only source of randomness; OMPL's seeds are drawn from it. The same state gives the same path unless
            the time limit strikes; PRM and PRMstar, which share time among threads, may give another.
        time_limit_s: wall-clock seconds for the search, the question what blocks included.
        checks: states and motions that may be checked.

    Raises:
        InputError: OMPL is not installed or has no such planner; START_IN_COLLISION or GOAL_IN_COLLISION.
        NoObjectPath: nothing found; says what blocks and which removable bodies would have to go.
    """
    return plan_waypoints(problem, rng, time_limit_s, checks, partial(OmplMotionSpace, known_planner(name)))


class OmplMotionSpace(MotionSpace):
    """Motion in SE(2) or SE(3) in which a planner of OMPL searches.

    Args:
        planner: its class name.
        problem: with the body's frame at its middle.
        planar: planar motion; otherwise motion in SE(3).
    """

    def __init__(self, planner: str, problem: ObjectPathProblem, planar: bool):
        super().__init__(problem, planar)
        self._planner = planner

    def search(
        self, number: int, rng: np.random.Generator, budget: SearchBudget
    ) -> tuple[ObjectChecker, np.ndarray] | None:
        """A free path (n, 7) and the checker that allows it.

        In the plane, the proof that there is none comes first. Then the planner from the start to the goal, with a
        budget that grows with the ``number`` of the round. Each round tries one narrower minimum distance more;
        later on, every second one searches a wider space.
        """
        if self.planar and number == 0:
            self.prove_separated()
        if self.infeasible:
            return None
        for checker in self.checkers[: number + 1]:
            if budget.exhausted:
                return None
            path = self._planned(checker, number, rng, budget)
            if path is not None:
                return checker, thinned(checker, path)
        return None

    def _planned(self, checker: ObjectChecker, number: int, rng, budget: SearchBudget) -> np.ndarray | None:
        """Poses (n, 7) of a free path that the planner finds with the budget of a round, or None."""
        start, goal = self.ends
        lower, upper = np.minimum(start, goal)[:3], np.maximum(start, goal)[:3]
        box = self.bounds_of_round(number)
        bounds = np.array([np.minimum(box[0], lower), np.maximum(box[1], upper)])
        checks = _Checks(checker)
        with seeded(rng):
            turn = TURN_WEIGHT * checker.radius
            space = PlanarPoses(start, bounds, turn) if self.planar else SpatialPoses(bounds, turn)
            query = Query(self._planner, space, checks, start, goal, STEPS[number % len(STEPS)])
            path = query.solve(int(min(EVALUATIONS * GROWTH**number, budget.checks)), budget.seconds)
        budget.spend(checks.evaluations)
        return path


class PlanarPoses(Space):
    """SE(2): poses (7,) that differ from a reference by planar motion.

    Args:
        reference: T_world_obj (7,).
        bounds: (2, 3) lower and upper position, m.
        turn: metres that a radian of turn counts as.
    """

    def __init__(self, reference: np.ndarray, bounds: np.ndarray, turn: float):
        base = modules().base
        space = base.SE2StateSpace()
        space.setBounds(box_bounds(*bounds[:, :2]))
        space.setSubspaceWeight(1, turn)
        super().__init__(space)
        self._reference = reference

    def read(self, state) -> np.ndarray:
        """The pose (7,) of a state."""
        return planar_pose(self._reference, state.getX(), state.getY(), state.getYaw())

    def write(self, state, values: np.ndarray) -> None:
        """Makes a state that of a pose (7,)."""
        state.setXY(float(values[0]), float(values[1]))
        state.setYaw(float(wrapped(planar_yaw(self._reference, values))))


class SpatialPoses(Space):
    """SE(3): poses (7,).

    Args:
        bounds: (2, 3) lower and upper position, m.
        turn: metres that a radian of turn counts as.
    """

    def __init__(self, bounds: np.ndarray, turn: float):
        base = modules().base
        space = base.SE3StateSpace()
        space.setBounds(box_bounds(*bounds))
        space.setSubspaceWeight(1, 2.0 * turn)  # OMPL's distance of rotations is half the angle
        super().__init__(space)

    def read(self, state) -> np.ndarray:
        """The pose (7,) of a state."""
        q = state.rotation()
        return np.array([state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w])

    def write(self, state, values: np.ndarray) -> None:
        """Makes a state that of a pose (7,)."""
        state.setXYZ(*(float(v) for v in values[:3]))
        q = state.rotation()
        q.x, q.y, q.z, q.w = (float(v) for v in values[3:])


class _Checks:
    """The checks of an ObjectChecker, counted: states and motions alike."""

    def __init__(self, checker: ObjectChecker):
        self.evaluations = 0
        self._checker = checker

    def state_free(self, T: np.ndarray) -> bool:
        """Whether the body may be at pose T (7,)."""
        self.evaluations += 1
        return self._checker.pose_free(T)

    def motion_free(self, T0: np.ndarray, T1: np.ndarray) -> bool:
        """Whether the whole motion from T0 to T1 (7,) is free."""
        self.evaluations += 1
        return self._checker.motion_free(T0, T1)

    def free_part(self, T0: np.ndarray, T1: np.ndarray) -> float:
        """Parameter up to which the motion from T0 to T1 (7,) is free of collisions."""
        self.evaluations += 1
        return self._checker.free_part(T0, T1)


def thinned(checker: ObjectChecker, path: np.ndarray) -> np.ndarray:
    """A path (n, 7) of more than MAX_CORNERS with those corners left out that the motion from the last kept one can."""
    if len(path) <= MAX_CORNERS:
        return path
    kept = [0]
    for k in range(2, len(path)):
        if not checker.motion_free(path[kept[-1]], path[k]):
            kept.append(k - 1)
    return path[[*kept, len(path) - 1]]
