"""What motions to goals on joint limits cost, compared with motions of the same joint distances inside the limits.

Each case is two motions of one robot. The second one is the first one with some joints shifted, so that these end on a
limit; all differences between start and goal stay the same. The straight motions of both are free of collisions, so
that only the limits make a difference.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from hmap_core.exceptions import MotionError
from hmap_core.planner import plan_motion, segments
from hmap_core.types import Scene

INSIDE = 0.15  # share of its range that a joint stays away from both limits
MOST_ON_LIMITS = 3  # joints that end on a limit in one case, at most
TIME_LIMIT = 10.0  # s for each motion
LOOKS = 20  # at the straight way of a motion
DRAWS = 10_000  # of cases, before a scene is given up


@dataclass(frozen=True)
class Motion:
    """Start and goal (n,) of a motion."""

    start: np.ndarray
    goal: np.ndarray


@dataclass
class Costs:
    """What the motions of one kind have cost.

    Attributes:
        seconds: CPU time of each.
        failures: how many were not found.
    """

    seconds: list[float] = field(default_factory=list)
    failures: int = 0


def cases(scene: Scene, robot: str, seed: int) -> Iterator[tuple[Motion, Motion]]:
    """Pairs of motions: inside the limits, and to a goal on limits; the straight ways of both are free of collisions.

    Args:
        scene: with the robot.
        robot: its name.
        seed: the only source of randomness.
    """
    rng = np.random.default_rng(seed)
    lower, upper = scene.robots[robot].model.position_limits
    room = INSIDE * (upper - lower)
    for _ in range(DRAWS):
        start, goal = rng.uniform(lower + room, upper - room, (2, len(lower)))
        joints = rng.permutation(len(lower))[: rng.integers(1, MOST_ON_LIMITS + 1)]
        on_limits = goal.copy()
        on_limits[joints] = np.where(goal > start, upper, lower)[joints]
        pair = Motion(start, goal), Motion(start + (on_limits - goal), on_limits)
        if all(_is_free(scene, robot, motion) for motion in pair):
            yield pair


def _is_free(scene: Scene, robot: str, motion: Motion) -> bool:
    """Whether the straight way of a motion is free of collisions, at LOOKS places."""
    state = scene.start_state()
    for share in np.linspace(0.0, 1.0, LOOKS):
        state.q[robot] = motion.start + share * (motion.goal - motion.start)
        if segments.standing_collision(scene, state, robot) is not None:
            return False
    return True


def measure(
    scene: Scene, robot: str, count: int, seed: int = 0, progress: Callable[[int], None] = lambda number: None
) -> tuple[Costs, Costs]:
    """CPU times of ``count`` cases: of the motions inside the limits, and of those to goals on limits.

    Args:
        scene: with the robot.
        robot: its name.
        count: of cases.
        seed: of the cases.
        progress: called with the number of each case.
    """
    costs = Costs(), Costs()
    pairs = cases(scene, robot, seed)
    _time(scene, robot, next(pairs)[0], Costs())  # loads the compiled code
    for number, pair in zip(range(count), pairs, strict=False):
        progress(number)
        for motion, own in list(zip(pair, costs, strict=True))[:: 1 if number % 2 else -1]:
            _time(scene, robot, motion, own)
    return costs


def _time(scene: Scene, robot: str, motion: Motion, costs: Costs) -> None:
    state = scene.start_state()
    state = replace(state, q=state.q | {robot: motion.start})
    began = time.process_time()
    try:
        plan_motion(scene, robot, q=motion.goal, state=state, time_limit=TIME_LIMIT)
    except MotionError:
        costs.failures += 1
    costs.seconds.append(time.process_time() - began)
