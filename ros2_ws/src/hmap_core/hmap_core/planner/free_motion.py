"""A transit of one robot to a configuration or to a pose of its end effector, without any object."""

import time
from collections import deque
from dataclasses import replace

import numpy as np

from hmap_core.arguments import checked_pose, checked_seed, checked_time_limit
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.deadline import usable
from hmap_core.exceptions import Code, InputError, MotionError, PlannerError
from hmap_core.komo.allowances import OVERLAP_ALLOWED, RELAXATION
from hmap_core.komo.features import pose_params
from hmap_core.komo.ik import solve_ik_batch
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import Phase
from hmap_core.komo.transcription import KomoProblem
from hmap_core.planner import segments
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.segments.transits import NoWayOut
from hmap_core.timed_work import work_until
from hmap_core.trajectory.measured_limits import configuration_within_limits, within_limits
from hmap_core.types import Scene, SceneState

DEFAULT_TIME_LIMIT = 10.0  # s
IK_STARTS = 64  # random configurations, beside the present one and home, from which inverse kinematics begins
CONFIGURATIONS = 8  # solutions of it that are tried as goals, the nearest first
SAME_CONFIGURATION = 0.05  # rad; solutions that differ by less are one
UNIT = 1e-4  # what the norm of a quaternion may be off 1


def plan_motion(
    scene: Scene,
    robot: str,
    *,
    q: np.ndarray | None = None,
    T_world_ee: np.ndarray | None = None,
    state: SceneState | None = None,
    seed: int = 0,
    time_limit: float = DEFAULT_TIME_LIMIT,
) -> SubTrajectory:
    """Plans how a robot moves past all bodies and robots of a scene, which stand, with its gripper as it is.

    KOMO from the straight motion of the joints; where that does not work, searches by two trees
    (:mod:`hmap_core.planner.transit`) until the time is up. The motion is free between its steps, too,
    and within the robot's limits.

    Joints and fingers that are beyond a limit by no more than a measurement may be are on it
    (:mod:`hmap_core.trajectory.measured_limits`); ``notes`` of what is returned say so. Start and goal may overlap with
    something by OVERLAP_ALLOWED; the motion comes out of there and goes in. Where no motion does, that is told at once.

    Args:
        q: (n,) configuration in which it has to end, rad; or
        T_world_ee: (7,) pose at which its end-effector frame has to end. One of both is needed.
        state: where everything is now; None: where the scene starts.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time; a goal to which there is no way takes all of it.

    Raises:
        InputError: the robot is unknown, a value has the wrong shape or is beyond the limits, or the robot stands
            in something at the start (START_IN_COLLISION) or at the goal (GOAL_IN_COLLISION), deeper than is allowed
            or without a way out.
        MotionError: no configuration reaches the pose (OUT_OF_REACH), or no way was found (NO_MOTION).
    """
    limit = checked_time_limit(time_limit)
    deadline = time.monotonic() + usable(limit)
    try:
        with work_until(deadline):
            return _motion(scene, robot, q, T_world_ee, state, checked_seed(seed), deadline)
    except PlannerError as error:
        if error.code != Code.TIME_LIMIT:
            raise
        raise MotionError(f"no motion of '{robot}' was found within {limit:g} s", Code.NO_MOTION) from error


def _motion(
    scene: Scene,
    robot: str,
    q: np.ndarray | None,
    T_world_ee: np.ndarray | None,
    state: SceneState | None,
    seed: int,
    deadline: float,
) -> SubTrajectory:
    """:func:`plan_motion` until a deadline (``time.monotonic()``). Raises PlannerError when that is over."""
    rng = np.random.default_rng(seed)
    if robot not in scene.robots:
        raise InputError(f"robot '{robot}' is unknown; the scene has {', '.join(scene.robots)}", Code.UNKNOWN_ROBOT)
    if (q is None) == (T_world_ee is None):
        raise InputError("give one goal: q or T_world_ee")
    state, notes = within_limits(scene, scene.start_state() if state is None else state)
    _check_standing(scene, state, robot, state.q[robot], "start", Code.START_IN_COLLISION)
    if q is None:
        goals = _configurations(scene, state, robot, checked_pose(T_world_ee, "T_world_ee", UNIT), rng)
    else:
        goal, moved = configuration_within_limits(scene.robots[robot], q, "goal")
        _check_standing(scene, state, robot, goal, "goal", Code.GOAL_IN_COLLISION)
        goals, notes = [goal], (*notes, *moved)
    tries = deque(goals)
    while True:
        try:
            motion = segments.go(scene, state, robot, tries[0], rng, deadline - time.monotonic())
            return replace(motion, notes=notes)
        except NoWayOut as error:
            if error.end == "start":
                raise _enclosed(scene, state, robot, state.q[robot], "start", Code.START_IN_COLLISION) from error
            last = tries.popleft()
            if not tries:
                raise _enclosed(scene, state, robot, last, "goal", Code.GOAL_IN_COLLISION) from error
        except MotionError:
            if time.monotonic() > deadline:
                raise
            tries.rotate(-1)


def _check_standing(scene: Scene, state: SceneState, robot: str, q: np.ndarray, what: str, code: Code) -> None:
    """Raises InputError where a robot stands in something at q (n,)."""
    there = state.copy()
    there.q[robot] = q
    hit = segments.standing_collision(scene, there, robot)
    if hit is not None:
        raise InputError(
            f"'{robot}' is {hit[1] * 1e3:.2f} mm inside at its {what}: {' and '.join(hit[0])}; "
            f"at most {OVERLAP_ALLOWED * 1e3:g} mm is allowed",
            code,
        )


def _enclosed(scene: Scene, state: SceneState, robot: str, q: np.ndarray, what: str, code: Code) -> InputError:
    """The error where no motion leads out of what a robot touches at q (n,)."""
    names, depth = _standing(scene, state, robot, q)
    return InputError(
        f"'{robot}' is {depth * 1e3:.2f} mm inside at its {what}, and no motion leads out of there: "
        f"{' and '.join(names)}",
        code,
    )


def _configurations(scene: Scene, state: SceneState, robot: str, T_world_ee: np.ndarray, rng) -> list[np.ndarray]:
    """Free configurations (n,) with the end-effector at a pose (7,), the nearest to the present one first.

    Where none keeps the clearances of a transit, those that overlap with something by less than OVERLAP_ALLOWED.

    Raises:
        MotionError: OUT_OF_REACH; there is none.
    """
    manipulation = Manipulation(scene, state, robot, None)
    problem = manipulation.ik_problem(manipulation.standing_collisions(), Phase.TRANSIT)
    found = _found_by_ik(manipulation, problem, T_world_ee, rng)
    if not found:
        cols = problem.arrays()
        overlapping = cols._replace(min_distance=np.minimum(cols.min_distance, RELAXATION - OVERLAP_ALLOWED))
        found = _found_by_ik(manipulation, problem.keeping(overlapping), T_world_ee, rng)
    if not found:
        anywhere = _found_by_ik(manipulation, problem.among(CollisionModel()), T_world_ee, rng)
        hits = [_standing(scene, state, robot, q) for q in anywhere]
        found = [q for q, (_, depth) in zip(anywhere, hits, strict=True) if depth <= OVERLAP_ALLOWED]
        if not found:
            place = ", ".join(f"{value:.3f}" for value in T_world_ee[:3])
            names, depth = min(hits, key=lambda hit: hit[1], default=((), 0.0))
            inside = f"; it would be {depth * 1e3:.2f} mm inside: {' and '.join(names)}" if hits else ""
            raise MotionError(
                f"'{robot}' reaches no free configuration with its end-effector at ({place}){inside}",
                Code.OUT_OF_REACH,
            )
    return found[:CONFIGURATIONS]


def _standing(scene: Scene, state: SceneState, robot: str, q: np.ndarray) -> tuple[tuple[str, ...], float]:
    """What a robot touches most at q (n,): the names of the two parts, and how deep it is inside (m, 0 or more)."""
    there = state.copy()
    there.q[robot] = q
    hit = segments.standing_collision(scene, there, robot, allowed=-RELAXATION)
    return ((), 0.0) if hit is None else (hit[0], max(hit[1], 0.0))


def _found_by_ik(
    manipulation: Manipulation, problem: KomoProblem, T_world_ee: np.ndarray, rng: np.random.Generator
) -> list[np.ndarray]:
    """Different solutions (n,) of a one-step problem with the end-effector at a pose (7,), the nearest first."""
    chain, now = manipulation.model.chain, manipulation.state.q[manipulation.robot]
    random = rng.uniform(chain.lower, chain.upper, (IK_STARTS, len(now)))
    home = manipulation.scene.robots[manipulation.robot].model.home
    starts = np.concatenate([[now, home], random])
    params = np.tile(pose_params(manipulation.T_tip_ee, T_world_ee), (len(starts), 1))
    found, feasible = solve_ik_batch(problem, params, starts, starts)
    kept: list[np.ndarray] = []
    for configuration in sorted(found[feasible], key=lambda configuration: float(np.abs(configuration - now).max())):
        if all(np.abs(configuration - other).max() > SAME_CONFIGURATION for other in kept):
            kept.append(configuration)
    return kept
