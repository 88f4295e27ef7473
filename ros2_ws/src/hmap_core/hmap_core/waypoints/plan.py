"""Algorithm 2 of the paper, ObjectBasedRRT: a path of the object alone, and its waypoints."""

import time
from dataclasses import dataclass

import numpy as np

from hmap_core.transforms import multiply, pose, rotation_matrix
from hmap_core.waypoints.checker import Geometry, ObjectChecker, body_middle, check_ends, flattened, recentred
from hmap_core.waypoints.kernels import lengths
from hmap_core.waypoints.problem import NoObjectPath, ObjectPath, ObjectPathProblem
from hmap_core.waypoints.resample import chord_step, consistent, cut, resample
from hmap_core.waypoints.roadmap import SAME_POSE, direct_path, exits
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.shorten import smooth

# start and goal within this are at the same height and tilt
SAME_HEIGHT = 1e-3  # m
SAME_TILT = float(np.deg2rad(1.0))
# how far beyond start and goal the search looks for room, m
SEARCH_REACH = 1.0
# share of the time limit for planar motion when spatial motion may be tried after it
PLANAR_SHARE = 0.4
# share of the time limit for asking whether removable bodies are what blocks
REMOVAL_SHARE = 0.25
DEFAULT_TIME_LIMIT = 5.0  # s
# shares of the problem's margin that are tried where the whole is too much
TIGHTER = (0.25,)
# each further series of searches by trees may check this many times more motions
GROWTH = 2


def plan_waypoints(
    problem: ObjectPathProblem, rng: np.random.Generator, time_limit_s: float = DEFAULT_TIME_LIMIT
) -> ObjectPath:
    """Plan the object's own path and cut it into waypoints.

    Args:
        problem: the body, its start and goal, what stands around.
        rng: the only source of randomness; the same state gives the same path unless the time limit strikes.
        time_limit_s: wall-clock seconds for the search, the question what blocks included.

    Raises:
        InputError: START_IN_COLLISION or GOAL_IN_COLLISION, with the bodies and depths.
        NoObjectPath: nothing found; says what blocks and which removable bodies would have to go.
    """
    began = time.monotonic()
    share = 1.0 - REMOVAL_SHARE if problem.removable else 1.0
    found, checkers = _search(problem, rng, began, share * time_limit_s)
    if found is not None:
        return _finished(problem, found, smooth(found.checker, found.poses, rng))
    raise _failure(problem, checkers, rng, began + time_limit_s)


@dataclass(frozen=True)
class Corners:
    """A free path as the search found it, before it is shortened."""

    poses: np.ndarray  # (n, 7) T_world_middle: of a frame at ``middle`` in the body, about which its motions turn
    checker: ObjectChecker  # that allows it
    middle: np.ndarray  # (3,) in the body's frame, m


def find_corners(
    problem: ObjectPathProblem, rng: np.random.Generator, time_limit_s: float = DEFAULT_TIME_LIMIT
) -> Corners | None:
    """The search of :func:`plan_waypoints` alone: any free path, or None when none was found in time.

    Raises:
        InputError: as :func:`plan_waypoints`.
    """
    return _search(problem, rng, time.monotonic(), time_limit_s)[0]


def _search(problem, rng, began, time_limit_s) -> tuple[Corners | None, list[ObjectChecker]]:
    """Try planar and spatial motion as the problem allows, in a frame in the middle of the body."""
    middle = body_middle(problem.body)
    central = recentred(problem, middle)
    geometry = Geometry(central)
    check_ends(central, geometry)
    tried = []
    for planar, share in _motions(problem):
        checker = ObjectChecker(central, geometry, planar, problem.margin)
        tighter = [share_of * problem.margin for share_of in TIGHTER if problem.margin > 0.0]
        checkers = [checker, *(checker.with_margin(margin) for margin in tighter)]
        if planar and problem.motion == "auto" and checkers[0].support is None:
            continue
        tried += checkers
        found = _corners(central, checkers, rng, began + share * time_limit_s)
        if found is not None:
            return Corners(found[1], found[0], middle), tried
    return None, tried


def _motions(problem: ObjectPathProblem) -> list[tuple[bool, float]]:
    """Kinds of motion to try (planar?) and the share of the time limit at which each gives up."""
    if problem.motion == "planar":
        return [(True, 1.0)]
    if problem.motion == "spatial" or not _planar_possible(problem):
        return [(False, 1.0)]
    return [(True, PLANAR_SHARE), (False, 1.0)]


def _planar_possible(problem: ObjectPathProblem) -> bool:
    """Whether start and goal share height and tilt."""
    a, b = (rotation_matrix(T)[2] for T in (problem.start, problem.goal))
    tilt = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return bool(abs(problem.start[2] - problem.goal[2]) <= SAME_HEIGHT and tilt <= SAME_TILT)


def search_bounds(problem: ObjectPathProblem, checker: ObjectChecker) -> np.ndarray:
    """Lower and upper position (2, 3) that the search may use: round start, goal and what stands near them.

    Wide enough to pass beyond the obstacles, with the margin that the checker asks for.
    """
    if problem.bounds is not None:
        return np.asarray(problem.bounds, float)
    ends = np.array([problem.start[:3], problem.goal[:3]])
    near = np.array([ends.min(0) - SEARCH_REACH, ends.max(0) + SEARCH_REACH])
    reach = checker.radius + checker.margin
    points = [ends.min(0) - reach, ends.max(0) + reach]
    for lower, upper in zip(checker.obstacles.lower, checker.obstacles.upper, strict=True):
        points += [lower - reach, upper + reach]
    wanted = np.array([np.min(points, axis=0), np.max(points, axis=0)])
    return np.array([np.maximum(wanted[0], near[0]), np.minimum(wanted[1], near[1])])


def _corners(problem, checkers, rng, deadline) -> tuple[ObjectChecker, np.ndarray] | None:
    """A free path (n, 7) and the checker that allows it, the wider margin first.

    Straight, else in the plane by two trees that grow for a moment, else by the small roadmap; then by trees from the
    exits of start and goal, with growing budgets.
    """
    bounds = search_bounds(problem, checkers[0])
    start = np.asarray(problem.start, float)
    ends = []
    for checker in checkers:
        goal = flattened(problem, problem.goal) if checker.planar else np.asarray(problem.goal, float)
        path = _first_tries(checker, start, goal, bounds, rng, deadline)
        if path is not None:
            return checker, path
        ends.append(tuple([T, *exits(checker, T, o, bounds)] for T, o in ((start, goal), (goal, start))))
    scale = 1
    while time.monotonic() < deadline:
        for checker, (starts, goals) in zip(checkers, ends, strict=True):
            path = rrt_path(checker, starts, goals, bounds, rng, deadline, scale)
            if path is not None:
                # a tree may begin at an exit; the way from the true end to it was found free
                path = np.concatenate([starts[:1], path, goals[:1]])
                return checker, path[np.concatenate(([True], lengths(path, checker.radius) > SAME_POSE))]
        scale *= GROWTH
    return None


def _first_tries(checker, start, goal, bounds, rng, deadline) -> np.ndarray | None:
    """What is fast where it works; poses (n, 7) or None."""
    if checker.motion_free(start, goal):
        return np.array([start, goal])
    path = None
    if checker.planar:  # in space the trees go round what the roadmap lifts the body over
        path = rrt_path(checker, [start], [goal], bounds, rng, deadline, rounds=ROUNDS[:1])
    return direct_path(checker, start, goal, bounds) if path is None else path


def _finished(problem: ObjectPathProblem, found: Corners, corners: np.ndarray) -> ObjectPath:
    checker, middle = found.checker, found.middle
    dense, where = resample(corners, chord_step(float(np.linalg.norm(middle))))
    poses = np.array([multiply(T, pose(-middle)) for T in dense]) if middle.any() else dense.copy()
    for k, T in ((0, problem.start), (-1, problem.goal)):
        poses[k] = T
    motion = "planar" if checker.planar else "spatial"
    return ObjectPath(consistent(poses), cut(corners, where, checker.radius), checker.clearances(dense), motion)


def _failure(problem, checkers, rng, deadline) -> NoObjectPath:
    """Name what blocks, and whether a path exists without the removable bodies."""
    central = recentred(problem, body_middle(problem.body))
    straight: list[str] = []
    frontier: list[str] = []
    leaves = ""
    for checker in checkers:
        goal = flattened(central, central.goal) if checker.planar else central.goal
        straight += checker.hit_by(central.start, goal)
        if not checker.supported_along(central.start, goal):
            leaves = " and leaves the support"
        stopped = np.argsort(-checker.blocked, kind="stable")
        frontier += [checker.owners[j] for j in stopped if checker.blocked[j] and not checker.contact[j]]
    straight = list(dict.fromkeys(straight))
    frontier = [name for name in dict.fromkeys(frontier) if name not in straight]
    free_without = _free_without(problem, straight + frontier, rng, deadline)
    what = f"the straight way hits {_listed(straight) or 'nothing'}{leaves}"
    what += f", the search ran into {_listed(frontier)}" if frontier else ""
    hint = ""
    if problem.removable:
        found = f"; without {_listed(free_without)} there is one" if free_without else None
        hint = found or "; none was found without the removable bodies either"
    kinds = " or ".join(dict.fromkeys("planar" if c.planar else "spatial" for c in checkers))
    return NoObjectPath(
        f"no {kinds} path of '{problem.body.name}' to its goal was found: {what}{hint}",
        tuple(straight + frontier),
        free_without,
    )


def _listed(names) -> str:
    return ", ".join(f"'{name}'" for name in names or ())


def _free_without(problem, blockers, rng, deadline) -> tuple[str, ...] | None:
    """The removable bodies to take away for a path to exist: one if one is enough, else all that are in the way."""
    names = [b for b in blockers if b in problem.removable]
    tries = [(n,) for n in names] + ([tuple(names)] if len(names) > 1 else [])
    rest = tuple(sorted(problem.removable))
    tries += [rest] if rest and set(rest) != set(names) else []
    for k, gone in enumerate(tries):
        now = time.monotonic()
        limit = max(deadline - now, 0.0) / (len(tries) - k)
        if _search(problem.without(frozenset(gone)), rng, now, limit)[0] is not None:
            return gone
    return None
