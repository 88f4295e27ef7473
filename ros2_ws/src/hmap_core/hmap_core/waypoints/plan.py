"""Algorithm 2 of the paper, ObjectBasedRRT: the path of the object without a robot, and its waypoints."""

from dataclasses import dataclass

import numpy as np

from hmap_core import clock
from hmap_core.deadline import usable
from hmap_core.exceptions import Code, PlannerError
from hmap_core.timed_work import work_until
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
    budget = SearchBudget(time_limit_s, checks, seconds=usable(time_limit_s))
    known = _Known()
    try:
        with work_until(budget.deadline):
            _search(problem, known, rng, budget, make_space)
    except PlannerError as error:
        if error.code != Code.TIME_LIMIT:
            raise
    if known.search is None:
        what = f"no path of '{problem.body.name}' to its goal was found: none was looked at"
        raise NoObjectPath(f"{what}; the search ended with {budget.ended_by}", (), None)
    if known.removal is not None:
        path = _finished(problem.without(frozenset(known.removal.names)), known.removal.corners, rng, budget)
        raise _failure(known.search, known.needed, budget, None, known.removal, path)
    if known.found is None:
        raise _failure(known.search, known.needed, budget, known.last)
    return _finished(problem, known.found, rng, budget)


@dataclass
class _Known:
    """What is known of a problem; its search may end at any time.

    Attributes:
        needed: removable bodies at the goal.
        search: the search with everything in its place.
        last: the search that decides whether there is a path: the same one, or the one without the removable bodies.
        found: a path with everything in its place.
        removal: bodies without which there is a path.
    """

    needed: frozenset[str] = frozenset()
    search: ObjectSearch | None = None
    last: ObjectSearch | None = None
    found: Corners | None = None
    removal: Removal | None = None


def _search(problem: ObjectPathProblem, known: _Known, rng, budget: SearchBudget, make_space: SpaceFactory) -> None:
    """Search a path, and note what is found. Raises InputError where an end is in collision, PlannerError late."""
    obstacles = ObstacleShapes.of(problem.obstacles)
    known.needed = check_ends(problem, obstacles)
    known.search = known.last = ObjectSearch(problem, make_space, obstacles, budget.clock_deadline)
    if problem.removable:
        _around_or_through(problem, known, known.search, rng, budget, make_space)
    else:
        known.found = known.search.rounds(rng, budget)


def _around_or_through(
    problem: ObjectPathProblem,
    known: _Known,
    search: ObjectSearch,
    rng: np.random.Generator,
    budget: SearchBudget,
    make_space: SpaceFactory,
) -> None:
    """Search alternately for a path around the removable bodies and for one through them."""
    needed = known.needed
    if not needed:
        known.found = search.rounds(rng, budget.fraction(1.0 - REMOVAL_SHARE), ROUNDS_AROUND_REMOVABLE)
    known.last = cleared = ObjectSearch(problem.without(problem.removable), make_space, deadline=budget.clock_deadline)
    while known.found is None and not cleared.infeasible and not budget.exhausted:
        through = cleared.round(rng, budget)
        if through is not None:
            known.removal = fewest_removals(problem, through, needed, rng, budget, make_space)
            return
        known.found = None if needed else search.round(rng, budget)


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
