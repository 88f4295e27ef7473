"""The search for a free path of one body: planar and spatial motion, wide and narrow minimum distances, in rounds
that grow."""

from dataclasses import dataclass

import numpy as np

from hmap_core.transforms import rotation_matrix
from hmap_core.waypoints.checker import Geometry, ObjectChecker, body_middle, flattened, recentred
from hmap_core.waypoints.effort import Effort
from hmap_core.waypoints.kernels import lengths
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.roadmap import SAME_POSE, direct_path, exits
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.separation import separated

# start and goal within this are at the same height and tilt
SAME_HEIGHT = 1e-3  # m
SAME_TILT = float(np.deg2rad(1.0))
# how far beyond start and goal the search looks for room, m
SEARCH_REACH = 1.0
# minimum distances in metres that are tried where the problem's is too much
TIGHTER = (0.002, 0.0005)
# each further round of searches by trees may check this many times more motions
GROWTH = 2
# rounds for planar motion alone, when spatial motion may be tried after it
PLANAR_ROUNDS = 2


@dataclass(frozen=True)
class Corners:
    """A free path as the search found it, before it is shortened."""

    poses: np.ndarray  # (n, 7) T_world_middle: of a frame at ``middle`` in the body, about which its motions turn
    checker: ObjectChecker  # that allows it
    middle: np.ndarray  # (3,) in the body's frame, m


class ObjectSearch:
    """A search that goes on where it stopped: every call of :meth:`round` may check more motions than the last.

    Start and goal are taken to be free; see ``checker.check_ends``.

    Attributes:
        checkers: those that have been searched with.
    """

    def __init__(self, problem: ObjectPathProblem):
        self.middle = body_middle(problem.body)
        self.problem = recentred(problem, self.middle)
        self.checkers: list[ObjectChecker] = []
        self._geometry = Geometry(self.problem)
        self._kinds = [_Kind(self.problem, planar) for planar in _motions(self.problem)]
        self._rounds = 0

    @property
    def hopeless(self) -> bool:
        """Whether it is proven that there is no path within the bounds of the search."""
        return all(kind.hopeless for kind in self._kinds)

    def fresh_checkers(self) -> list[ObjectChecker]:
        """The checkers of the first kind of motion that makes sense, before anything is searched."""
        kinds = list(self._kinds)
        while not kinds[0].checkers and not kinds[0].prepare(self._geometry, last=len(kinds) == 1):
            kinds.pop(0)
        return kinds[0].checkers

    def round(self, rng: np.random.Generator, effort: Effort) -> Corners | None:
        """A free path, or None when this round has found none.

        Args:
            rng: the only source of randomness.
            effort: what may be done at most.
        """
        for k, kind in enumerate(list(self._kinds)):
            waiting = 0 if k == 0 or self._kinds[0].hopeless else PLANAR_ROUNDS
            if self._rounds < waiting:
                continue
            if not kind.checkers and not kind.prepare(self._geometry, last=k == len(self._kinds) - 1):
                self._kinds.remove(kind)
                return self.round(rng, effort)
            self.checkers += [c for c in kind.checkers if c not in self.checkers]
            found = kind.search(self._rounds - waiting, rng, effort)
            if found is not None:
                return Corners(found[1], found[0], self.middle)
        self._rounds += 1
        return None

    def rounds(self, rng: np.random.Generator, effort: Effort, count: int | None = None) -> Corners | None:
        """What the first successful of ``count`` rounds finds (None: as many as the effort allows), or None."""
        done = 0
        while not self.hopeless and not effort.over and (count is None or done < count):
            found = self.round(rng, effort)
            if found is not None:
                return found
            done += 1
        return None


class _Kind:
    """One kind of motion: its checkers, the wider minimum distance first, and what they have learnt."""

    def __init__(self, problem: ObjectPathProblem, planar: bool):
        self.problem, self.planar = problem, planar
        self.checkers: list[ObjectChecker] = []
        self.ends: list[tuple[list[np.ndarray], list[np.ndarray]]] = []
        self.bounds: np.ndarray | None = None
        self.hopeless = False  # proven to have no path

    def prepare(self, geometry: Geometry, last: bool) -> bool:
        """Make the checkers; False where this kind makes no sense: a slide off what does not carry the body."""
        problem = self.problem
        checker = ObjectChecker(problem, geometry, self.planar, problem.min_distance)
        if self.planar and not last and checker.support is None:
            return False
        tighter = [min_distance for min_distance in TIGHTER if min_distance < problem.min_distance]
        self.checkers = [checker, *(checker.with_margin(min_distance) for min_distance in tighter)]
        self.bounds = search_bounds(problem, checker)
        return True

    def search(self, number: int, rng, effort: Effort) -> tuple[ObjectChecker, np.ndarray] | None:
        """A free path (n, 7) and the checker that allows it.

        Straight, else in the plane by two trees that grow for a moment, else by the small roadmap; then by trees from
        the exits of start and goal, with budgets that grow with the ``number`` of the round.
        """
        if self.hopeless:
            return None
        start = np.asarray(self.problem.start, float)
        goal = np.asarray(self.problem.goal, float)
        goal = flattened(self.problem, goal) if self.planar else goal
        for checker in self.checkers[len(self.ends) :]:
            path = _first_tries(checker, start, goal, self.bounds, rng, effort)
            if path is not None:
                return checker, path
            if self.planar and not self.ends:
                self.hopeless = separated(self.checkers[-1], start, goal, self.bounds)
            if self.hopeless:
                return None
            self.ends.append(tuple([T, *exits(checker, T, o, self.bounds)] for T, o in ((start, goal), (goal, start))))
        for checker, (starts, goals) in zip(self.checkers, self.ends, strict=True):
            path = rrt_path(checker, starts, goals, self.bounds, rng, effort, GROWTH**number)
            if path is not None:
                # a tree may begin at an exit; the way from the true end to it was found free
                path = np.concatenate([starts[:1], path, goals[:1]])
                return checker, path[np.concatenate(([True], lengths(path, checker.radius) > SAME_POSE))]
        return None


def find_corners(problem: ObjectPathProblem, rng: np.random.Generator, time_limit_s: float) -> Corners | None:
    """Any free path, or None when none was found in time; start and goal are taken to be free."""
    return ObjectSearch(problem).rounds(rng, Effort(time_limit_s))


def search_bounds(problem: ObjectPathProblem, checker: ObjectChecker) -> np.ndarray:
    """Lower and upper position (2, 3) that the search may use: round start, goal and what stands near them."""
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


def _motions(problem: ObjectPathProblem) -> list[bool]:
    """Kinds of motion to try, in this order: planar?"""
    if problem.motion == "planar":
        return [True]
    if problem.motion == "spatial" or not _planar_possible(problem):
        return [False]
    return [True, False]


def _planar_possible(problem: ObjectPathProblem) -> bool:
    """Whether start and goal share height and tilt."""
    a, b = (rotation_matrix(T)[2] for T in (problem.start, problem.goal))
    tilt = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return bool(abs(problem.start[2] - problem.goal[2]) <= SAME_HEIGHT and tilt <= SAME_TILT)


def _first_tries(checker, start, goal, bounds, rng, effort: Effort) -> np.ndarray | None:
    """What is fast where it works; poses (n, 7) or None."""
    if checker.motion_free(start, goal):
        return np.array([start, goal])
    path = None
    if checker.planar:  # in space the trees go round what the roadmap lifts the body over
        path = rrt_path(checker, [start], [goal], bounds, rng, effort, rounds=ROUNDS[:1])
    return direct_path(checker, start, goal, bounds) if path is None else path
