"""How fast a body may be moved: by the grip of the fingers on it, or by the friction of its support."""

import numpy as np

from hmap_core.collision.convex import convex_set
from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.contacts.grip_force import LIFT_ACCELERATION, pad_friction
from hmap_core.kinematics.arm import load_arm
from hmap_core.stability.mass import centre_of_mass
from hmap_core.trajectory.timing import PointLimits
from hmap_core.transforms import apply
from hmap_core.types import AttachedBody, Body, Gripper, Scene, TaskMode

GRASP_SPEED = 0.5  # m/s of what is grasped
PUSH_SPEED = 0.2  # m/s of what is pushed or pressed: these contacts are quasi-static
PRESS_ACCELERATION = 0.3  # m/s^2 of what is dragged from above: half of what the reserve of its force allows for
GRIP_SHARE = 0.7  # of the friction of the pads that weight and acceleration use together
SUPPORT_SHARE = 0.5  # of the deceleration by friction with which a pushed body keeps its contact
LARGEST = 2.0  # m/s^2 of any body


def grasped(scene: Scene, robot: str, body: Body | AttachedBody, T_ee_body: np.ndarray, opening: float) -> PointLimits:
    """Limits of the centre of mass of a body in the fingers of a robot.

    The pads' friction carries weight and acceleration, and the torque of both about the closing axis
    (:mod:`hmap_core.contacts.grasp_torque`). LIFT_ACCELERATION is what all grasps are checked for.

    Args:
        scene: with the robot.
        robot: name of the robot.
        body: what it grasps.
        T_ee_body: (7,) pose of the body in the end-effector frame.
        opening: of the gripper, m.
    """
    centre = apply(T_ee_body, centre_of_mass(convex_set(body.shapes)))
    model = scene.robots[robot].model
    acceleration = LARGEST
    if scene.mode == TaskMode.PHYSICAL and model.gripper is not None and body.mass > 0.0:
        held = _held_weight(model.gripper, pad_friction(body, model), centre, opening)
        acceleration = GRIP_SHARE * held / body.mass - GRAVITY
    return _limits(scene, robot, centre, GRASP_SPEED, float(np.clip(acceleration, LIFT_ACCELERATION, LARGEST)))


def _held_weight(gripper: Gripper, friction: float, centre: np.ndarray, opening: float) -> float:
    """Force (N) on a centre of mass (3,) in the end-effector frame that the pads resist in all directions."""
    reach = gripper.reach_at(opening) if gripper.tips else 0.0
    arm = max(float(np.hypot(centre[0], centre[2] - reach)), 1e-6)  # m, from the closing axis
    force = min(2.0 * friction, 1.0) * gripper.force
    return min(force, 4.0 / 3.0 * friction * gripper.force * gripper.pad_half_width / arm)


def pushed(scene: Scene, robot: str, body: str, T_ee_body: np.ndarray) -> PointLimits:
    """Limits of the centre of mass of a body that a robot pushes: it slows down by friction before its contact ends."""
    pushed = scene.bodies[body]
    centre = apply(T_ee_body, centre_of_mass(convex_set(pushed.shapes)))
    acceleration = LARGEST
    if scene.mode == TaskMode.PHYSICAL:
        acceleration = min(LARGEST, SUPPORT_SHARE * max(pushed.friction, 1e-3) * GRAVITY)
    return _limits(scene, robot, centre, PUSH_SPEED, acceleration)


def pressed(scene: Scene, robot: str, body: str, T_ee_body: np.ndarray) -> PointLimits:
    """Limits of the centre of mass of a body that a robot drags by pressing on it."""
    centre = apply(T_ee_body, centre_of_mass(convex_set(scene.bodies[body].shapes)))
    return _limits(scene, robot, centre, PUSH_SPEED, PRESS_ACCELERATION)


def attached(scene: Scene, robot: str) -> PointLimits | None:
    """Limits of the centre of mass of the body that is attached to a robot; None if there is none."""
    held = scene.robots[robot].model.attached
    if held is None:
        return None
    return grasped(scene, robot, held, held.T_ee_body, held.opening)


def _limits(scene: Scene, robot: str, centre: np.ndarray, speed: float, acceleration: float) -> PointLimits:
    placed = scene.robots[robot]
    arm = load_arm(placed.model)
    return PointLimits(lambda q: apply(placed.base_pose, arm.positions_of(centre, q)), speed, acceleration)
