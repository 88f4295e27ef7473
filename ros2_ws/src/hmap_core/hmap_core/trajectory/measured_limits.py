"""Joints and fingers that are measured a little beyond a limit: onto the limit, with a note; farther ones are refused.

Encoders, calibration and controllers are not exact, so a robot that stands on a limit is measured on either side of it.
Everything that plans from a state, or to a configuration, reads it here.
"""

import numpy as np

from hmap_core.arguments import checked_numbers, checked_pose
from hmap_core.exceptions import InputError
from hmap_core.kinematics.urdf import load_urdf
from hmap_core.types import JOINT_TOLERANCE, OPENING_TOLERANCE, Gripper, Robot, RobotModel, Scene, SceneState

ROUNDING = 1e-9  # rad or m


def within_limits(scene: Scene, state: SceneState) -> tuple[SceneState, tuple[str, ...]]:
    """A state with all joints and fingers within their limits.

    Args:
        scene: with the robots.
        state: where everything is, as measured.

    Returns:
        The state, the same object where it is within the limits; and a note for each value that was changed.

    Raises:
        InputError: the state lacks a robot or a body of the scene, has a pose that is none or a wrong number of
            joints, or a joint is beyond its limits by more than JOINT_TOLERANCE, or an opening by more than
            OPENING_TOLERANCE.
    """
    missing = sorted(scene.bodies.keys() - state.poses.keys())
    if missing:
        raise InputError(f"the state lacks poses of {', '.join(missing)}; it needs one of each body")
    for name in scene.bodies:
        checked_pose(state.poses[name], f"start pose of '{name}'")
    q, gripper, notes = dict(state.q), dict(state.gripper), []
    for name, robot in scene.robots.items():
        if name not in q or (robot.model.gripper is not None and name not in gripper):
            raise InputError(f"the state lacks joints or gripper of robot '{name}'; it needs both")
        q[name], moved = configuration_within_limits(robot, q[name], "start")
        gripper[name], opened = _opening_within_limits(robot, gripper.get(name, 0.0))
        notes += [*moved, *opened]
    same = gripper == state.gripper and all(q[name] is state.q[name] for name in q)
    return (state, ()) if same else (SceneState(q, gripper, state.poses), tuple(notes))


def configuration_within_limits(robot: Robot, q: np.ndarray, what: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """A configuration (n,) within the limits of a robot's joints, and a note for each joint that was changed.

    Args:
        robot: whose joints they are.
        q: (n,) rad, or m for sliding joints.
        what: what it is, for messages: ``start`` or ``goal``.

    Raises:
        InputError: a wrong number of joints, a value that is not finite, or one that is beyond a limit by more than
            JOINT_TOLERANCE.
    """
    model, n = robot.model, len(robot.model.home)
    q = checked_numbers(q, n, f"{what} of '{robot.name}'", f"{n} finite joint positions")
    lower, upper = model.position_limits
    if ((lower <= q) & (q <= upper)).all():
        return q, ()
    kept = np.clip(q, lower, upper)
    _check_excess(model, q, kept, f"{what} of '{robot.name}'")
    notes = [
        _note(f"{what} of '{robot.name}': {model.joint_names[i]}", q[i], kept[i]) for i in np.flatnonzero(kept != q)
    ]
    return kept, tuple(notes)


def _check_excess(model: RobotModel, q: np.ndarray, kept: np.ndarray, what: str) -> None:
    far = np.abs(q - kept) > JOINT_TOLERANCE + ROUNDING
    if far.any():
        i = int(far.argmax())
        low, high = model.position_limits[:, i]
        raise InputError(
            f"{what} has {model.joint_names[i]} at {q[i]:.4f}; allowed: {low:.4f} to {high:.4f}, "
            f"and {JOINT_TOLERANCE:g} beyond for what is measured"
        )


def _opening_within_limits(robot: Robot, opening: float) -> tuple[float, tuple[str, ...]]:
    """An opening (m) that the fingers can have, and a note where it was changed."""
    gripper = robot.model.gripper
    if gripper is None:
        return opening, ()
    if not isinstance(opening, int | float | np.number):
        raise InputError(f"opening of the gripper of '{robot.name}' is {opening!r}; needed: a number of metres")
    ends = _openings(gripper)
    if min(ends) <= opening <= max(ends):
        return opening, ()
    low, high = _opening_range(robot.model, gripper)
    kept = float(np.clip(opening, low, high))
    if kept == opening:
        return opening, ()
    if not abs(opening - kept) <= OPENING_TOLERANCE + ROUNDING:
        raise InputError(
            f"start of '{robot.name}' has its fingers {opening:.4f} m apart ({', '.join(gripper.joint_names)}); "
            f"allowed: {low:.4f} to {high:.4f}, and {OPENING_TOLERANCE:g} beyond for what is measured"
        )
    return kept, (_note(f"start of '{robot.name}': opening of the gripper", opening, kept),)


def _opening_range(model: RobotModel, gripper: Gripper) -> tuple[float, float]:
    """Least and largest opening (m) of the robot file, or of the URDF's joints where these allow more."""
    ends = _openings(gripper)
    if not gripper.openings:
        tree = load_urdf(model.urdf).tree
        joints = [tree.by_name[name] for name in gripper.joint_names]
        limits = np.array([[joint.lower, joint.upper] for joint in joints]).T
        openings = (limits - gripper.joints(0.0)) / gripper.joints_per_opening(0.0)  # of each joint, (2, k)
        low, high = openings.min(axis=0).max(), openings.max(axis=0).min()
        ends += [low, high] if np.isfinite([low, high]).all() and low < high else []
    return float(min(ends)), float(max(ends))


def _openings(gripper: Gripper) -> list[float]:
    """Openings (m) that the robot file names."""
    return [gripper.min_opening, gripper.open_opening, *gripper.openings[:1], *gripper.openings[-1:]]


def _note(what: str, value: float, kept: float) -> str:
    return f"{what} is measured at {value:.4f}, beyond its limit; {kept:.4f} is planned with"
