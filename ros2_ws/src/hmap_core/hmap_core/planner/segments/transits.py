"""Transit of a robot to a configuration, with its hand as it is, and what a robot stands in."""

from collections.abc import Iterator

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.deadline import check_time
from hmap_core.exceptions import MotionError
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.allowances import OVERLAP_ALLOWED, relaxed, verification
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.pair_blocks import MANY_PAIRS, PairChecks
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.result import KomoResult
from hmap_core.komo.segment import transit_skeleton
from hmap_core.komo.transcription import KomoProblem
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.segments.parts import at_rest
from hmap_core.planner.segments.timing import timed_transit
from hmap_core.planner.segments.verification import is_free
from hmap_core.planner.segments.ways_out import is_tight, way_out
from hmap_core.planner.transit import find_transit
from hmap_core.planner.transit_search import FindTransit, TransitSearch
from hmap_core.types import Scene, SceneState

JOINT_STEP = 0.2  # rad between two steps of a transit, about
TRANSIT_STEPS = (8, 24)  # least and most
BESIDE = 0.05  # m from a first guess within which pairs count from the beginning, where there are many
ROUNDS = 3  # of solving with the pairs that count
SMOOTHNESS = 1.0 / 160.0  # weight of the squared accelerations, times the number of steps cubed
STIFFNESS = 30.0  # first penalty of the constraints, as a multiple of that weight: first guesses are nearly feasible


class NoWayOut(MotionError):
    """No motion was found that leaves an overlap at an end of a transit.

    Attributes:
        end: "start" or "goal".
    """

    def __init__(self, reason: str, end: str):
        super().__init__(reason)
        self.end = end


def standing_collision(
    scene: Scene, state: SceneState, robot: str, object: str | None = None, allowed: float = OVERLAP_ALLOWED
) -> tuple[tuple[str, str], float] | None:
    """What a robot stands in by more than is allowed: the names of the two parts and how deep (m); else None.

    Args:
        object: that is to be handled.
        allowed: m.
    """
    manipulation = Manipulation(scene, state, robot, object)
    collisions = manipulation.standing_collisions()
    cols = collisions.arrays()
    cols = cols._replace(min_distance=np.full_like(cols.min_distance, -allowed))
    q = np.ascontiguousarray(state.q[robot])[None]
    excess, pair = path_violations(q, np.ones(1, np.int64), manipulation.model.chain, cols, 0.0)
    return None if pair[0] < 0 else (collisions.pair_name(int(pair[0])), float(excess[0]) + allowed)


def transit(
    scene: Scene,
    state: SceneState,
    robot: str,
    q: np.ndarray,
    rng: np.random.Generator,
    deadline: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """Plan a transit of a robot past everything that stands.

    Where it touches something at an end, or overlaps with it, and the optimiser finds no motion, it first leaves that
    on a way out (:mod:`hmap_core.planner.segments.ways_out`).

    Args:
        scene, state: the world, and where everything is.
        robot: name of the robot.
        q: (n,) goal configuration, rad.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which the search ends.
        find: searches a transit where the optimiser finds none.

    Raises:
        NoWayOut: no motion leads out of an overlap at an end.
        MotionError: NO_MOTION.
    """
    manipulation = Manipulation(scene, state, robot, None)
    chain, start = manipulation.model.chain, state.q[robot]
    steps = transit_steps(start, q)
    problem = manipulation.problem(transit_skeleton(robot, q), (steps,), path_options(steps))
    alone = problem.arrays()
    cols = _relaxed_at_ends(chain, alone, start, q)
    check_time()
    result = _solved(problem, cols, start, straight(start, q, steps))
    path = np.concatenate([start[None], result.path]) if result.feasible else None
    if path is not None and not is_free(chain, verification(cols), path):
        path = None
    if path is None and is_tight(alone, cols):
        return _by_ways_out(manipulation, alone, q, rng, deadline, find)
    search = TransitSearch(manipulation, problem.collisions, cols, start, q, 1, find)
    if path is None or not search.has_room(path):
        searched = _first_free(chain, verification(cols), search.ways(rng, deadline, path is None))
        path = path if searched is None else searched
        if path is None:
            raise MotionError(f"robot '{robot}' finds no way to move on: {result.worst}")
    return at_rest(scene, robot, timed_transit(scene, robot, path), state.gripper[robot])


def _solved(problem: KomoProblem, cols: Collisions, start: np.ndarray, guess: np.ndarray) -> KomoResult:
    """The problem solved from a first guess (T, n).

    Of many pairs only those count that come near the guess, and then the paths that were found; the others are looked
    at when the path is verified.
    """
    if len(cols.a) <= MANY_PAIRS:
        return problem.keeping(cols).solve(start, guess)
    checks = PairChecks(problem.chain, cols)
    near = checks.near(guess, BESIDE)
    for _ in range(ROUNDS):
        check_time()
        own = cols._replace(phases=np.where(near, cols.phases, 0))
        result = problem.keeping(own).solve(start, guess)
        fresh = checks.near(result.path, 0.0) & ~near
        if not (result.feasible and fresh.any()):
            break
        near |= fresh
    return result


def _by_ways_out(
    manipulation: Manipulation,
    cols: Collisions,
    q: np.ndarray,
    rng: np.random.Generator,
    deadline: float,
    find: FindTransit,
) -> SubTrajectory:
    """A transit between configurations that keep all minimum distances, with ways out of start and goal q (n,).

    Raises:
        NoWayOut: there is no such way.
        MotionError: NO_MOTION.
    """
    scene, state, robot = manipulation.scene, manipulation.state, manipulation.robot
    ways = []
    for end, configuration in (("start", state.q[robot]), ("goal", q)):
        if not is_tight(cols, relaxed(manipulation.model.chain, cols, configuration, 1)):
            ways.append(configuration[None])
            continue
        way = way_out(manipulation, cols, configuration, rng)
        if way is None:
            raise NoWayOut(f"robot '{robot}' finds no way out of what it touches at its {end}", end)
        ways.append(way)
    out = state.copy()
    out.q[robot] = ways[0][-1]
    between = transit(scene, out, robot, ways[1][-1], rng, deadline, find).trajectory.joints[robot]
    leaving, coming = (timed_transit(scene, robot, way) if len(way) > 1 else way for way in (ways[0], ways[1][::-1]))
    return at_rest(scene, robot, np.concatenate([leaving, between[1:], coming[1:]]), state.gripper[robot])


def _relaxed_at_ends(chain: Chain, cols: Collisions, start: np.ndarray, goal: np.ndarray) -> Collisions:
    """The pairs with the minimum distances that start and goal (n,) have; the goal overlaps OVERLAP_ALLOWED at most."""
    at_start = relaxed(chain, cols, start, 1)
    at_goal = relaxed(chain, at_start, goal, 1)
    deepest = np.minimum(at_start.min_distance, -OVERLAP_ALLOWED)
    return at_goal._replace(min_distance=np.maximum(at_goal.min_distance, deepest))


def _first_free(chain: Chain, cols: Collisions, ways: Iterator[np.ndarray]) -> np.ndarray | None:
    """The first of some ways (m, n) that is free as a spline."""
    return next((way for way in ways if is_free(chain, cols, way)), None)


def path_options(steps: int) -> SolverOptions:
    """The solver's options for a path of so many steps."""
    weight = SMOOTHNESS * steps**3
    return SolverOptions(acceleration=weight, mu=max(SolverOptions.mu, STIFFNESS * weight), mu_max=1e8)


def transit_steps(a: np.ndarray, b: np.ndarray) -> int:
    """Steps of a transit from a to b (n,)."""
    return int(np.clip(np.ceil(np.abs(b - a).max() / JOINT_STEP), *TRANSIT_STEPS))


def straight(a: np.ndarray, b: np.ndarray, steps: int) -> np.ndarray:
    """Configurations (steps, n) straight from a, without it, to b (n,)."""
    return a + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (b - a)
