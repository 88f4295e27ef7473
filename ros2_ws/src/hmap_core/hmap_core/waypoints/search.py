"""The search for a free path of one body: planar and spatial motion, several minimum distances, growing budgets."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hmap_core.transforms import rotation_matrix
from hmap_core.waypoints.checker import (
    Geometry,
    ObjectChecker,
    ObstacleShapes,
    body_middle,
    planar_projection,
    recentred,
)
from hmap_core.waypoints.enclosure import Enclosure, enclosure
from hmap_core.waypoints.kernels import lengths
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.roadmap import SAME_POSE, direct_path, exits
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.search_budget import SearchBudget
from hmap_core.waypoints.separation import separated

# start and goal that differ by less have the same height and tilt
SAME_HEIGHT = 1e-3  # m
SAME_TILT = float(np.deg2rad(1.0))
# the search space extends this far beyond start and goal at first, m; it is widened if no path is found in it
SEARCH_REACH = 1.0
# factor of that reach from one widening to the next
WIDENING = 2.0
# round from which on every second one searches a wider space; most paths are found before
WIDER_FROM = 3
# smaller minimum distances in m that are tried if no path with the problem's exists
TIGHTER = (0.002, 0.0005)
# factor of the trees' budget of motions from one round to the next
GROWTH = 2
# rounds with planar motion only, if spatial motion is allowed, too
PLANAR_ROUNDS = 2
# rounds after which it is looked whether obstacles enclose start or goal; most paths are found before
ROUNDS_BEFORE_PROOF = 3


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
        infeasible: whether it is proven that no path exists, in however wide a space.
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

    def widened(self, times: int) -> np.ndarray:
        """The bounds (2, 3) of the search space after some widenings; beyond all obstacles they stay as they are."""
        return search_bounds(self.problem, self.checkers[0], SEARCH_REACH * WIDENING**times)

    def bounds_of_round(self, number: int) -> np.ndarray:
        """The bounds (2, 3) in which a round searches: from WIDER_FROM on, those of every second round are wider."""
        wider = number >= WIDER_FROM and (number - WIDER_FROM) % 2 == 0
        return self.widened(number - 1) if wider else self.bounds

    def prove_separated(self) -> bool:
        """Look for the proof that no planar path exists: obstacles separate start from goal.

        While they do so only within the bounds of the search, these are widened. At the end, ``infeasible`` says
        whether there is no path in however wide a space.

        Returns:
            Whether the bounds were widened.
        """
        start, goal = self.ends
        first, times = self.bounds, 0
        while separated(self.checkers[-1], start, goal, self.bounds):
            times += 1
            wider = self.widened(times)
            if np.array_equal(wider, self.bounds):
                self.infeasible = True
                break
            self.bounds = wider
        return self.bounds is not first

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
        Then trees grow from the exits of start and goal; their budgets grow with the ``number`` of the round. Later
        on, every second round searches a wider space, up to one that holds all obstacles.

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
                wider = self.prove_separated()
                if self.infeasible:
                    return None
                path = _first_tries(checker, start, goal, self.bounds, rng, budget) if wider else None
                if path is not None:
                    return checker, path
            self._exits.append(self._all_exits(checker, self.bounds))
        bounds = self.bounds_of_round(number)
        wider = not np.array_equal(bounds, self.bounds)
        for checker, known in zip(self.checkers, self._exits, strict=True):
            starts, goals = self._all_exits(checker, bounds) if wider else known
            path = rrt_path(checker, starts, goals, bounds, rng, budget, GROWTH**number)
            if path is not None:
                # a tree can start at an exit; the motion from the true end to it is known to be free
                path = np.concatenate([starts[:1], path, goals[:1]])
                return checker, path[np.concatenate(([True], lengths(path, checker.radius) > SAME_POSE))]
        return None

    def _all_exits(self, checker: ObjectChecker, bounds: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Start and goal, each with the poses that free motions along one axis reach from it."""
        start, goal = self.ends
        return [start, *exits(checker, start, goal, bounds)], [goal, *exits(checker, goal, start, bounds)]


# makes a motion space from a problem and whether its motion is planar
SpaceFactory = Callable[[ObjectPathProblem, bool], MotionSpace]


class ObjectSearch:
    """A search that can be continued: every call of :meth:`round` can check more motions than the last.

    Start and goal must be free; see ``checker.check_ends``.

    Args:
        problem: its start and goal must be free.
        make_space: makes the search in planar or spatial motion.
        obstacles: the shapes of the problem's obstacles, if they are known.
        deadline: when checks end, in seconds of ``clock.now``.

    Attributes:
        checkers: those used so far.
        enclosure: the proof that no motion leads from start to goal, once it was found.
    """

    def __init__(
        self,
        problem: ObjectPathProblem,
        make_space: SpaceFactory = MotionSpace,
        obstacles: ObstacleShapes | None = None,
        deadline: float = np.inf,
    ):
        self.middle = body_middle(problem.body)
        self.problem = recentred(problem, self.middle)
        self.checkers: list[ObjectChecker] = []
        self.enclosure: Enclosure | None = None
        self._geometry = Geometry(self.problem, obstacles, deadline)
        self._spaces = [make_space(self.problem, planar) for planar in _motion_spaces(self.problem)]
        self._rounds = 0

    @property
    def infeasible(self) -> bool:
        """Whether it is proven that no path exists; within the bounds of the problem, if it has any."""
        return self.enclosure is not None or all(space.infeasible for space in self._spaces)

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
            A free path, or None if this round has found none, or if it is proven that there is none.
        """
        if self._rounds == ROUNDS_BEFORE_PROOF:
            problem, geometry = self.problem, self._geometry
            self.enclosure = enclosure(
                problem.body.name, geometry.body, geometry.obstacles, problem.start, problem.goal, geometry.deadline
            )
        if self.infeasible:
            return None
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
    budget = SearchBudget(time_limit_s)
    return ObjectSearch(problem, make_space, deadline=budget.clock_deadline).rounds(rng, budget)


def search_bounds(problem: ObjectPathProblem, checker: ObjectChecker, reach: float = SEARCH_REACH) -> np.ndarray:
    """Lower and upper position (2, 3) in m of the search space: around start, goal and the obstacles near them.

    Args:
        problem: its own bounds, if it has any, are the search space.
        checker: with the obstacles.
        reach: largest distance beyond start and goal, m. A reach that holds all obstacles with room for the body round
            them is as good as an infinite one.
    """
    if problem.bounds is not None:
        return np.asarray(problem.bounds, float)
    ends = np.array([problem.start[:3], problem.goal[:3]])
    near = np.array([ends.min(0) - reach, ends.max(0) + reach])
    room = checker.radius + checker.min_distance
    lower = np.concatenate([ends, checker.obstacles.lower]).min(axis=0) - room
    upper = np.concatenate([ends, checker.obstacles.upper]).max(axis=0) + room
    return np.array([np.maximum(lower, near[0]), np.minimum(upper, near[1])])


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
