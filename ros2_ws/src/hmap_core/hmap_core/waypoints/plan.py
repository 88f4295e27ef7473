"""Algorithm 2 of the paper, ObjectBasedRRT: the path of the object without a robot, and its waypoints."""

import numpy as np

from hmap_core import clock
from hmap_core.transforms import multiply, pose
from hmap_core.waypoints.blocking import Removal, fewest_removals
from hmap_core.waypoints.checker import ObstacleShapes, check_ends, planar_projection
from hmap_core.waypoints.problem import NoObjectPath, ObjectPath, ObjectPathProblem
from hmap_core.waypoints.resample import chord_step, consistent, cut, resample
from hmap_core.waypoints.search import Corners, MotionSpace, ObjectSearch, SpaceFactory
from hmap_core.waypoints.search_budget import SearchBudget
from hmap_core.waypoints.shorten import smooth

DEFAULT_TIME_LIMIT = 5.0  # s
# rounds of search around the removable bodies before the search tests whether they block
ROUNDS_AROUND_REMOVABLE = 2
# share of the budget for that test
REMOVAL_SHARE = 0.25
# share of the time limit that shortening a path, or naming what blocks, can take after it
SHARE_AFTER = 0.03
# share of the time limit that shortening a path can take, however early it was found; the rest is for those who use it
SMOOTHING_SHARE = 0.3


def plan_waypoints(
    problem: ObjectPathProblem,
    rng: np.random.Generator,
    time_limit_s: float = DEFAULT_TIME_LIMIT,
    checks: float = np.inf,
    make_space: SpaceFactory = MotionSpace,
) -> ObjectPath:
    """Plan the path of the object and determine its waypoints.

    Args:
        problem: the body, its start and goal, and the obstacles.
        rng: the only source of randomness. The same state gives the same path unless the time limit ends the search.
        time_limit_s: wall-clock seconds for the whole search, including the test of which bodies block.
        checks: number of motions that the trees can check. The search ends after the same motions for the same rng.
        make_space: makes the search in planar or spatial motion: hmap's own, or another planner's.

    Returns:
        The path.

    Raises:
        InputError: START_IN_COLLISION or GOAL_IN_COLLISION, with the bodies and depths. A removable body at the goal
            is no error.
        NoObjectPath: no path was found. The exception names the blocking bodies, and the removable bodies whose removal
            makes a path possible.
    """
    budget = SearchBudget(time_limit_s, checks)
    obstacles = ObstacleShapes.of(problem.obstacles)
    needed = check_ends(problem, obstacles)
    search = ObjectSearch(problem, make_space, obstacles, budget.clock_deadline)
    if not problem.removable:
        found = search.rounds(rng, budget)
        if found is None:
            raise _failure(search, needed, budget, search)
    else:
        found = _around_or_through(problem, search, needed, rng, budget, make_space)
    return _finished(problem, found, rng, budget)


def _around_or_through(problem, search, needed, rng, budget: SearchBudget, make_space: SpaceFactory) -> Corners:
    """Search alternately for a path around the removable bodies and for one through them.

    Raises:
        NoObjectPath: no path was found, or a path seems to exist only if some removable bodies are removed.
    """
    found = None if needed else search.rounds(rng, budget.fraction(1.0 - REMOVAL_SHARE), ROUNDS_AROUND_REMOVABLE)
    cleared = ObjectSearch(problem.without(problem.removable), make_space, deadline=budget.clock_deadline)
    while found is None and not cleared.infeasible and not budget.exhausted:
        through = cleared.round(rng, budget)
        if through is not None:
            removal = fewest_removals(problem, through, needed, rng, budget, make_space)
            path = _finished(problem.without(frozenset(removal.names)), removal.corners, rng, budget)
            raise _failure(search, needed, budget, None, removal, path)
        found = None if needed else search.round(rng, budget)
    if found is None:
        raise _failure(search, needed, budget, cleared)
    return found


def _finished(problem: ObjectPathProblem, found: Corners, rng, budget: SearchBudget) -> ObjectPath:
    checker, middle = found.checker, found.middle
    checker.end_by(clock.now() + SMOOTHING_SHARE * budget.time_limit)
    checker.allow_until(_afterwards(budget))
    corners = smooth(checker, found.poses, rng)
    dense, where = resample(corners, chord_step(float(np.linalg.norm(middle))))
    poses = np.array([multiply(T, pose(-middle)) for T in dense]) if middle.any() else dense.copy()
    for k, T in ((0, problem.start), (-1, problem.goal)):
        poses[k] = T
    motion = "planar" if checker.planar else "spatial"
    return ObjectPath(consistent(poses), cut(corners, where, checker.radius), checker.clearances(dense), motion)


def _failure(
    search: ObjectSearch,
    needed: frozenset[str],
    budget: SearchBudget,
    last: ObjectSearch | None,
    removal: Removal | None = None,
    path: ObjectPath | None = None,
) -> NoObjectPath:
    """The exception that names the blocking bodies, whether a path exists without the removable ones, and how sure it
    is.

    Args:
        search: the search with everything in its place.
        needed: removable bodies at the goal.
        budget: what was left.
        last: the search that decides: the same one, or the one without the removable bodies; None if that found a path.
        removal: what has to be removed for that path.
        path: that path.
    """
    proven = last is not None and last.infeasible
    central = search.problem
    end = _afterwards(budget)
    straight = sorted(needed)
    frontier: list[str] = []
    leaves = ""
    checkers = search.checkers or ([] if budget.seconds <= 0.0 else search.fresh_checkers())
    for checker in checkers:
        checker.allow_until(end)
        goal = planar_projection(central, central.goal) if checker.planar else central.goal
        straight += checker.hit_by(central.start, goal)
        if not checker.supported_along(central.start, goal):
            leaves = " and leaves the support"
        stopped = np.argsort(-checker.blocked, kind="stable")
        frontier += [checker.owners[j] for j in stopped if checker.blocked[j] and not checker.contact[j]]
    straight = list(dict.fromkeys(straight))
    frontier = [name for name in dict.fromkeys(frontier) if name not in straight]
    what = f"the straight way hits {_listed(straight) or 'nothing'}{leaves}" if checkers else "none was looked at"
    what += f", the search ran into {_listed(frontier)}" if frontier else ""
    removal_note = ""
    if central.removable:
        found = f"; without {_listed(removal.names)} there is one" if removal else None
        removal_note = found or "; none was found without the removable bodies either"
    sure = ""
    if removal is None:
        why = f": {last.enclosure}" if last is not None and last.enclosure is not None else ""
        limit = " within its bounds" if central.bounds is not None else ""
        sure = (
            "; it is proven that there is none" + limit + why
            if proven
            else f"; the search ended with {budget.ended_by}"
        )
    kinds = " or ".join(dict.fromkeys("planar" if c.planar else "spatial" for c in search.checkers)) or "free"
    return NoObjectPath(
        f"no {kinds} path of '{central.body.name}' to its goal was found: {what}{removal_note}{sure}",
        tuple(straight + frontier),
        removal.names if removal else None,
        path,
        proven,
    )


def _afterwards(budget: SearchBudget) -> float:
    """Until when the work after a search may take, in seconds of ``clock.now``."""
    return clock.now() + SHARE_AFTER * budget.time_limit


def _listed(names) -> str:
    return ", ".join(f"'{name}'" for name in names)
