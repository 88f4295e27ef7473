"""How fast the parts of a segment are: trajectories along paths, and the openings of grippers."""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.press_efforts import PRESS_TIME
from hmap_core.planner.segments.carried import attached
from hmap_core.trajectory.timing import PointLimits, TimedPath, time_parameterise
from hmap_core.types import Gripper, Scene

SAMPLE_PERIOD = 0.02  # s between two samples of a plan
# Shares of the joint limits that are used: of a transit, and with an object, when a controller has to stay within the
# clearance. The object has limits of its own, see :mod:`hmap_core.planner.segments.carried`.
FREE_SPEED, FREE_ACCELERATION = 0.9, 0.5
HOLD_SPEED, HOLD_ACCELERATION = 0.5, 0.25
SETTLE = 0.3  # s that the fingers get to settle after they have closed or opened
PRESS_SAMPLES = round(PRESS_TIME / SAMPLE_PERIOD)  # of a plan, in which a hand stands to press or to let go
SAME_OPENING = 1e-9  # m


def timed(
    scene: Scene, robot: str, path: np.ndarray, speed: float, acceleration: float, carried: PointLimits | None = None
) -> np.ndarray:
    """Samples (N, n) of a trajectory along a path (M, n), SAMPLE_PERIOD apart.

    Args:
        scene: with the robot.
        robot: name of the robot.
        path: (M, n) configurations.
        speed, acceleration: shares of the joint limits that may be used.
        carried: limits of what the robot moves along.

    Raises:
        MotionError: a point of the path is beyond the joint limits.
    """
    return timed_together(scene, (robot,), path, speed, acceleration, carried)[robot].q


def timed_together(
    scene: Scene,
    robots: Sequence[str],
    path: np.ndarray,
    speed: float,
    acceleration: float,
    carried: PointLimits | None = None,
) -> dict[str, TimedPath]:
    """The motion of each robot along a path (M, n) of all their joints, as slow as the slowest of them.

    Arguments and exceptions as of :func:`timed`.
    """
    models = [scene.robots[name].model for name in robots]
    velocities = np.concatenate([model.velocity_limits for model in models])
    accelerations = np.concatenate([model.acceleration_limits for model in models])
    positions = np.hstack([model.position_limits for model in models])
    limits = speed * velocities, acceleration * accelerations
    timed = time_parameterise(path, *limits, SAMPLE_PERIOD, positions, carried)
    ends = np.cumsum([len(model.joint_names) for model in models])[:-1]
    parts = zip(robots, np.split(timed.q, ends, axis=1), np.split(timed.qd, ends, axis=1), strict=True)
    return {name: TimedPath(timed.time, q, qd) for name, q, qd in parts}


def timed_contact(scene: Scene, robot: str, path: np.ndarray, carried: PointLimits | None) -> np.ndarray:
    """Samples (N, n) of a trajectory along a path (M, n) with an object, within its limits."""
    return timed(scene, robot, path, HOLD_SPEED, HOLD_ACCELERATION, carried)


def timed_transit(scene: Scene, robot: str, path: np.ndarray) -> np.ndarray:
    """Samples (N, n) of a transit along a path (M, n), slower with an attached body."""
    carried = attached(scene, robot)
    if carried is not None:
        return timed_contact(scene, robot, path, carried)
    return timed(scene, robot, path, FREE_SPEED, FREE_ACCELERATION)


def ramp(gripper: Gripper | None, a: float, b: float) -> np.ndarray:
    """Openings (N,) from a to b (m) at the gripper's speed, then at rest while it settles; none where a is b.

    Raises:
        ValueError: the opening changes, and there is no gripper.
    """
    if abs(a - b) < SAME_OPENING:
        return np.zeros(0)
    if gripper is None:
        raise ValueError(f"no gripper that could open from {a} to {b} m")
    moving = int(np.ceil(abs(b - a) / gripper.speed / SAMPLE_PERIOD))
    return np.concatenate([np.linspace(a, b, moving + 1), np.full(int(SETTLE / SAMPLE_PERIOD), b)])
