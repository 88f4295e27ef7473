"""How fast the parts of a segment are: trajectories along paths, and the openings of grippers."""

import numpy as np

from hmap_core.trajectory.timing import time_parameterise
from hmap_core.types import Gripper, Scene

SAMPLE_PERIOD = 0.02  # s between two samples of a plan
# Shares of the joint limits that are used. A transit is quick; with an object the robot is slow, so that friction keeps
# the object in the grasp and a controller stays within the clearance.
FREE_SPEED, FREE_ACCELERATION = 0.6, 0.3
HOLD_SPEED, HOLD_ACCELERATION = 0.2, 0.05
CARRY_SPEED, CARRY_ACCELERATION = 0.3, 0.08  # a transit with an attached tool
SETTLE = 0.3  # s that the fingers get to settle after they have closed or opened
SAME_OPENING = 1e-9  # m


def timed(scene: Scene, robot: str, path: np.ndarray, speed: float, acceleration: float) -> np.ndarray:
    """Samples (N, n) of a trajectory along a path (M, n), SAMPLE_PERIOD apart.

    Args:
        speed, acceleration: shares of the joint limits that may be used.

    Raises:
        MotionError: a point of the path is beyond the joint limits.
    """
    model = scene.robots[robot].model
    limits = speed * model.velocity_limits, acceleration * model.acceleration_limits
    return time_parameterise(path, *limits, SAMPLE_PERIOD, model.position_limits).q


def timed_contact(scene: Scene, robot: str, path: np.ndarray) -> np.ndarray:
    """Samples (N, n) of a trajectory along a path (M, n) with an object."""
    return timed(scene, robot, path, HOLD_SPEED, HOLD_ACCELERATION)


def timed_transit(scene: Scene, robot: str, path: np.ndarray) -> np.ndarray:
    """Samples (N, n) of a transit along a path (M, n), slower with an attached tool."""
    attached = scene.robots[robot].model.attached is not None
    return timed(
        scene, robot, path, *(CARRY_SPEED, CARRY_ACCELERATION) if attached else (FREE_SPEED, FREE_ACCELERATION)
    )


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
