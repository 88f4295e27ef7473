"""The search for a free path of one body: planar and spatial motion, several minimum distances, growing budgets."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hmap_core.transforms import rotation_matrix
from hmap_core.waypoints.checker import Geometry, ObjectChecker, body_middle, planar_projection, recentred
from hmap_core.waypoints.kernels import lengths
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.roadmap import SAME_POSE, direct_path, exits
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.search_budget import SearchBudget
from hmap_core.waypoints.separation import separated

# start and goal that differ by less have the same height and tilt
SAME_HEIGHT = 1e-3  # m
SAME_TILT = float(np.deg2rad(1.0))
# the search space extends this far beyond start and goal, m
SEARCH_REACH = 1.0
# smaller minimum distances in m that are tried if no path with the problem's exists
TIGHTER = (0.002, 0.0005)
# factor of the trees' budget of motions from one round to the next
GROWTH = 2
# rounds with planar motion only, if spatial motion is allowed, too
PLANAR_ROUNDS = 2


@dataclass(frozen=True)
class Corners:
    """A free path as found by the search, before it is shortened."""

    poses: np.ndarray  # (n, 7) T_world_middle: the frame at ``middle`` in the body, about which motions turn
    checker: ObjectChecker  # for which the path is free
    middle: np.ndarray  # (3,) in the body's frame, m


class MotionSpace:
    """Planar or spatial motion and hmap's own search in it. A subclass can search with another method.

    Args:
        problem: with the body's frame at its middle.
        planar: planar motion; otherwise motion in SE(3).

    Attributes:
        checkers: the largest minimum distance first; empty before :meth:`prepare`.
        bounds: (2, 3) lower and upper position of the search space, m; None before :meth:`prepare`.
        infeasible: whether it is proven that no path exists.
    """

    def __init__(self, problem: ObjectPathProblem, planar: bool):
        self.problem, self.planar = problem, planar
        self.checkers: list[ObjectChecker] = []
        self.bounds: np.ndarray
        self.infeasible = False
        self._exits: list[tuple[list[np.ndarray], list[np.ndarray]]] = []  # of start and goal, for each checker

    def prepare(self, geometry: Geometry, last: bool) -> bool:
        """Make the checkers; False if the space does not apply: planar motion of a body that no support carries."""
        problem = self.problem
        checker = ObjectChecker(problem, geometry, self.planar, problem.min_distance)
        if self.planar and not last and checker.support is None:
            return False
        tighter = [min_distance for min_distance in TIGHTER if min_distance < problem.min_distance]
        self.checkers = [checker, *(checker.with_min_distance(min_distance) for min_distance in tighter)]
        self.bounds = search_bounds(problem, checker)
        return True

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Start and goal (7,); in planar motion the goal has the height and tilt of the start."""
        start, goal = (np.asarray(T, float) for T in (self.problem.start, self.problem.goal))
        return start, planar_projection(self.problem, goal) if self.planar else goal

    def search(
        self, number: int, rng: np.random.Generator, budget: SearchBudget
    ) -> tuple[ObjectChecker, np.ndarray] | None:
        """Search for a free path.

        The first round tries the straight motion, in planar motion a short run of two trees, and the small roadmap.
        Then trees grow from the exits of start and goal; their budgets grow with the ``number`` of the round.

        Args:
            number: of the round, from 0.
            rng: the only source of randomness.
            budget: limit of the search.

        Returns:
            The checker for which the path is free, and the path (n, 7); or None.
        """
        if self.infeasible:
            return None
        start, goal = self.ends
        for checker in self.checkers[len(self._exits) :]:
            path = _first_tries(checker, start, goal, self.bounds, rng, budget)
            if path is not None:
                return checker, path
            if self.planar and not self._exits:
                self.infeasible = separated(self.checkers[-1], start, goal, self.bounds)
            if self.infeasible:
                return None
            starts, goals = ([T, *exits(checker, T, o, self.bounds)] for T, o in ((start, goal), (goal, start)))
            self._exits.append((starts, goals))
        for checker, (starts, goals) in zip(self.checkers, self._exits, strict=True):
            path = rrt_path(checker, starts, goals, self.bounds, rng, budget, GROWTH**number)
            if path is not None:
                # a tree can start at an exit; the motion from the true end to it is known to be free
                path = np.concatenate([starts[:1], path, goals[:1]])
                return checker, path[np.concatenate(([True], lengths(path, checker.radius) > SAME_POSE))]
        return None


# makes a motion space from a problem and whether its motion is planar
SpaceFactory = Callable[[ObjectPathProblem, bool], MotionSpace]


class ObjectSearch:
    """A search that can be continued: every call of :meth:`round` can check more motions than the last.

    Start and goal must be free; see ``checker.check_ends``.

    Args:
        problem: its start and goal must be free.
        make_space: makes the search in planar or spatial motion.

    Attributes:
        checkers: those used so far.
    """

    def __init__(self, problem: ObjectPathProblem, make_space: SpaceFactory = MotionSpace):
        self.middle = body_middle(problem.body)
        self.problem = recentred(problem, self.middle)
        self.checkers: list[ObjectChecker] = []
        self._geometry = Geometry(self.problem)
        self._spaces = [make_space(self.problem, planar) for planar in _motion_spaces(self.problem)]
        self._rounds = 0

    @property
    def infeasible(self) -> bool:
        """Whether it is proven that no path exists within the bounds of the search."""
        return all(space.infeasible for space in self._spaces)

    def fresh_checkers(self) -> list[ObjectChecker]:
        """The checkers of the first motion space that applies, before any search."""
        spaces = list(self._spaces)
        while not spaces[0].checkers and not spaces[0].prepare(self._geometry, last=len(spaces) == 1):
            spaces.pop(0)
        return spaces[0].checkers

    def round(self, rng: np.random.Generator, budget: SearchBudget) -> Corners | None:
        """Search once with all motion spaces that are due.

        Args:
            rng: the only source of randomness.
            budget: limit of the search.

        Returns:
            A free path, or None if this round has found none.
        """
        for k, space in enumerate(list(self._spaces)):
            waiting = 0 if k == 0 or self._spaces[0].infeasible else PLANAR_ROUNDS
            if self._rounds < waiting:
                continue
            if not space.checkers and not space.prepare(self._geometry, last=k == len(self._spaces) - 1):
                self._spaces.remove(space)
                return self.round(rng, budget)
            self.checkers += [c for c in space.checkers if c not in self.checkers]
            found = space.search(self._rounds - waiting, rng, budget)
            if found is not None:
                return Corners(found[1], found[0], self.middle)
        self._rounds += 1
        return None

    def rounds(self, rng: np.random.Generator, budget: SearchBudget, count: int | None = None) -> Corners | None:
        """Search until a round finds a path.

        Args:
            rng: the only source of randomness.
            budget: limit of the search.
            count: number of rounds; None: until the budget is exhausted.

        Returns:
            A free path, or None.
        """
        done = 0
        while not self.infeasible and not budget.exhausted and (count is None or done < count):
            found = self.round(rng, budget)
            if found is not None:
                return found
            done += 1
        return None


def find_corners(
    problem: ObjectPathProblem,
    rng: np.random.Generator,
    time_limit_s: float,
    make_space: SpaceFactory = MotionSpace,
) -> Corners | None:
    """Find any free path.

    Args:
        problem: its start and goal must be free.
        rng: the only source of randomness.
        time_limit_s: wall-clock seconds.
        make_space: makes the search in planar or spatial motion: hmap's own, or another planner's.

    Returns:
        The path, or None if none was found within the time limit.
    """
    return ObjectSearch(problem, make_space).rounds(rng, SearchBudget(time_limit_s))


def search_bounds(problem: ObjectPathProblem, checker: ObjectChecker) -> np.ndarray:
    """Lower and upper position (2, 3) in m of the search space: around start, goal and the obstacles near them."""
    if problem.bounds is not None:
        return np.asarray(problem.bounds, float)
    ends = np.array([problem.start[:3], problem.goal[:3]])
    near = np.array([ends.min(0) - SEARCH_REACH, ends.max(0) + SEARCH_REACH])
    room = checker.radius + checker.min_distance
    points = [ends.min(0) - room, ends.max(0) + room]
    for lower, upper in zip(checker.obstacles.lower, checker.obstacles.upper, strict=True):
        points += [lower - room, upper + room]
    wanted = np.array([np.min(points, axis=0), np.max(points, axis=0)])
    return np.array([np.maximum(wanted[0], near[0]), np.minimum(wanted[1], near[1])])


def _motion_spaces(problem: ObjectPathProblem) -> list[bool]:
    """The motion spaces to try, in this order; True: planar."""
    if problem.motion == "planar":
        return [True]
    if problem.motion == "spatial" or not _planar_possible(problem):
        return [False]
    return [True, False]


def _planar_possible(problem: ObjectPathProblem) -> bool:
    """Whether start and goal have the same height and tilt."""
    a, b = (rotation_matrix(T)[2] for T in (problem.start, problem.goal))
    tilt = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return bool(abs(problem.start[2] - problem.goal[2]) <= SAME_HEIGHT and tilt <= SAME_TILT)


def _first_tries(checker, start, goal, bounds, rng, budget: SearchBudget) -> np.ndarray | None:
    """The fast methods; poses (n, 7) or None."""
    if checker.motion_free(start, goal):
        return np.array([start, goal])
    path = None
    if checker.planar:  # in spatial motion the trees would go around what the roadmap lifts the body over
        path = rrt_path(checker, [start], [goal], bounds, rng, budget, rounds=ROUNDS[:1])
    return direct_path(checker, start, goal, bounds) if path is None else path
