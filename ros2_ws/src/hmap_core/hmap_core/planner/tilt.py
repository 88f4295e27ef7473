"""Tilt of objects: robots whose hands keep theirs cannot change it."""

from dataclasses import replace

import numpy as np

from hmap_core.kinematics.arm import ALL_DIRECTIONS, load_arm
from hmap_core.transforms import inverse, multiply, quaternion_multiply, rotation_matrix
from hmap_core.types import Goal, Robot, Scene

SAMPLES = 4  # configurations in which the axes of an arm are looked at
UPRIGHT = 1.0 - 1e-9  # cosine of the angle with the vertical, above which an axis counts as vertical
SAME_TILT = 1e-6  # rad up to which a tilt counts as kept


def keeps_tilt(scene: Scene) -> bool:
    """Whether no robot of a scene reaches every orientation: what they carry then keeps its roll and pitch."""
    arms = [load_arm(robot.model) for robot in scene.robots.values()]
    return bool(arms) and all(arm.mobility < ALL_DIRECTIONS for arm in arms)


def never_tilts(scene: Scene) -> bool:
    """Whether the hands of all robots of a scene turn about the vertical only; then what they move keeps its tilt."""
    return bool(scene.robots) and all(_turns_upright(robot) for robot in scene.robots.values())


def _turns_upright(robot: Robot) -> bool:
    """Whether all turning joints of a robot have vertical axes, in all of some random configurations."""
    arm = load_arm(robot.model)
    lower, upper = robot.model.position_limits
    samples = np.random.default_rng(0).uniform(lower, upper, (SAMPLES, arm.n))
    axes = np.concatenate([arm.frames(q)[0][1:, :, 2][arm.prismatic == 0] for q in samples])
    return bool(np.all(np.abs((axes @ rotation_matrix(robot.base_pose).T)[:, 2]) > UPRIGHT))


def tilt_and_yaw(T0: np.ndarray, T1: np.ndarray) -> tuple[float, float]:
    """The rotation from pose T0 to T1 (7,) as angles (rad): about a horizontal axis after one about the vertical.

    Dobrowolski, "Swing-twist decomposition in Clifford algebra", 2015.
    """
    x, y, z, w = multiply(np.r_[np.zeros(3), T1[3:]], inverse(np.r_[np.zeros(3), T0[3:]]))[3:]
    tilt = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w))
    return float(tilt), float(2.0 * np.arctan2(z, w))


def levelled(goal: Goal, T_start: np.ndarray, share: float) -> Goal:
    """The goal with the object's tilt at T_start (7,), if a share of the rotation tolerance allows it."""
    tilt, yaw = tilt_and_yaw(T_start, goal.pose)
    if tilt > share * goal.rotation_tolerance:
        return goal
    turn = np.array([0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])
    return replace(goal, pose=np.concatenate([goal.pose[:3], quaternion_multiply(turn, T_start[3:])]))
