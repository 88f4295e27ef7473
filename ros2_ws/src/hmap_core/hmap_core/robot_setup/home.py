"""Guess of a home configuration: free of collisions, away from limits, with the hand in front of the base."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.robot_setup.self_distance import FAR, SelfDistance
from hmap_core.transforms import to_matrix
from hmap_core.types import RobotModel

STARTS = 30  # start configurations of the search
EVALUATIONS = 50  # of the pose of the hand and its derivative from each start
SAMPLES = 400  # random configurations, where the search finds none
FORWARD, UP = 0.5, 0.3  # place of the hand in front of the base and above it, as shares of the arm's reach
OFF_PLACE = 0.02  # m, and for unit vectors: error of the hand's pose that is accepted
TO_MIDDLE = 0.02  # weight of a joint's distance from the middle of its range
MAX_RANGE = np.pi  # rad or m: a joint with wider limits is used within these
LIMIT_SHARE = 0.2  # of a joint's range; a larger distance from its limits is no better
FLOOR = 0.01  # m, least height of the moving links over the base's origin


@dataclass(frozen=True)
class HomeGuess:
    """A home configuration.

    Attributes:
        q: (n,) rad or m.
        pointing_down: whether the hand points down in front of the base.
        clearance: m, smallest distance between links that are checked; negative in collision.
    """

    q: np.ndarray
    pointing_down: bool
    clearance: float


def guess_home(model: RobotModel, rng: np.random.Generator) -> HomeGuess:
    """Guesses a home configuration.

    From random configurations, the hand is brought in front of the base, with the approach direction downwards. Of the
    configurations found, the one with the best score is taken: the smallest of its clearance, its distance from the
    limits and its manipulability, each relative to a value that is enough. An arm that cannot do that, such as one with
    few joints, gets the best of random configurations.

    Args:
        model: the robot; its own home is not used.
        rng: source of randomness.

    Returns:
        The guess.
    """
    arm, checker = load_arm(model), SelfDistance(load_arm(model))
    lower, upper = _ranges(model.position_limits)
    found = []
    for start in rng.uniform(lower, upper, (STARTS, arm.n)):
        q = _bring(arm, start, lower, upper)
        if q is not None:
            found.append((_score(arm, checker, q), q))
    pointing = bool(found) and max(score for score, _ in found) > 0.0
    if not pointing:
        found = [(_score(arm, checker, q), q) for q in rng.uniform(lower, upper, (SAMPLES, arm.n))]
    _, q = max(found, key=lambda each: each[0])
    rounded = np.clip(np.round(q, 3), *model.position_limits)
    return HomeGuess(rounded, pointing, checker.nearest(rounded)[0])


def _ranges(limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Limits (n,) within which a joint is used: no more than MAX_RANGE from 0 where its own allow that."""
    lower, upper = limits
    wide = (lower < -MAX_RANGE) & (upper > MAX_RANGE)
    return np.where(wide, -MAX_RANGE, lower), np.where(wide, MAX_RANGE, upper)


def _bring(arm: Arm, start: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray | None:
    """A configuration (n,) near ``start`` with the hand in front of the base, pointing down; None if there is none."""
    middle, half = 0.5 * (lower + upper), np.maximum(0.5 * (upper - lower), 1e-9)
    place = arm.p_joint[0] * [1.0, 1.0, 0.0] + arm.span * np.array([FORWARD, 0.0, UP])

    def error(q: np.ndarray) -> np.ndarray:
        T = to_matrix(arm.end_effector(q))
        return np.concatenate([T[:3, 3] - place, T[:3, 2] + [0.0, 0.0, 1.0]])

    def residual(q: np.ndarray) -> np.ndarray:
        return np.concatenate([error(q), TO_MIDDLE * (q - middle) / half])

    q = least_squares(residual, start, bounds=(lower, upper), max_nfev=EVALUATIONS).x
    return q if np.linalg.norm(error(q)) < OFF_PLACE * np.sqrt(6.0) else None


def _score(arm: Arm, checker: SelfDistance, q: np.ndarray) -> float:
    """At most 1; not above 0 in collision, or with a link below the floor."""
    clearance = checker.nearest(q)[0]
    if clearance <= 0.0 or checker.lowest(q) < FLOOR:
        return min(clearance, 0.0)
    lower, upper = arm.model.position_limits
    limits = float((np.minimum(q - lower, upper - q) / (upper - lower)).min())
    singular = np.linalg.svd(_jacobian(arm, q), compute_uv=False)
    return min(clearance / FAR, limits / LIMIT_SHARE, 1.0) + float(singular[-1])


def _jacobian(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Jacobian (6, n) of the end effector, by forward differences; translations relative to the arm's span."""
    step = 1e-6
    T0 = to_matrix(arm.end_effector(q))
    columns = []
    for k in range(arm.n):
        T = to_matrix(arm.end_effector(q + step * np.eye(arm.n)[k]))
        turn = (T[:3, :3] @ T0[:3, :3].T - np.eye(3)) / step
        columns.append([*(T[:3, 3] - T0[:3, 3]) / step / arm.span, turn[2, 1], turn[0, 2], turn[1, 0]])
    return np.array(columns).T
