"""Whether a gripper and its arm hold the weight of a body: friction of the pads, and the payload of the arm.

Two pads press on opposite faces with the gripper's force F. Their Coulomb friction carries at most 2 mu F across the
closing axis. What a body weighs along that axis, one finger carries with at most F (Murray, Li & Sastry, *A
Mathematical Introduction to Robotic Manipulation*, 1994, section 5.2). A body that slides on its support needs the
friction of that support, at most mu m g.
"""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.transforms import rotation_matrices
from hmap_core.types import AttachedBody, Body, ContactKind, ContactPoint, RobotModel

LIFT_ACCELERATION = 0.6  # m/s^2, upper bound of a grasped body's acceleration; plans stay well below


def pad_friction(body: Body | AttachedBody, model: RobotModel) -> float:
    """Lateral Coulomb coefficient between a body and the pads: the lower one of both, where the pads' is known."""
    return min(body.friction, float(model.simulation.get("finger_friction", np.inf)))


def weight_ratio(body: Body, contacts: Sequence[ContactPoint], model: RobotModel, up: np.ndarray) -> np.ndarray:
    """Ratio of the force that a lifted body needs to the force that the pads give.

    Args:
        body: the grasped body.
        contacts: K contacts on it.
        model: of the robot; has a gripper.
        up: (3,) vertical direction in the body's frame.

    Returns:
        (K,) ratio; above 1 the body slips out of the gripper. 0 for contacts that are no grasps.
    """
    if not contacts:
        return np.zeros(0)
    force = model.require_gripper().force
    weight = body.mass * (GRAVITY + LIFT_ACCELERATION)
    closing = rotation_matrices(np.array([contact.T_obj_ee for contact in contacts]))[:, :, 1]
    along = np.abs(closing @ up)
    across = np.sqrt(np.clip(1.0 - along**2, 0.0, 1.0))
    friction = max(2.0 * pad_friction(body, model), 1e-9)
    ratio = weight / force * np.maximum(across / friction, along)
    grasps = np.array([contact.kind == ContactKind.GRASP for contact in contacts])
    return np.where(grasps, ratio, 0.0)


def lifting_problem(body: Body, name: str, model: RobotModel) -> str:
    """Why a robot cannot lift a body by any grasp; empty if its weight does not exclude it.

    Args:
        body: the body.
        name: of the robot.
        model: of the robot.
    """
    if model.gripper is None:
        return f"'{name}' has no gripper"
    problems = []
    if model.payload is not None and body.mass > model.payload:
        problems.append(f"'{name}' carries at most {model.payload:g} kg (payload)")
    friction, force = pad_friction(body, model), model.gripper.force
    needed, held = body.mass * (GRAVITY + LIFT_ACCELERATION), 2.0 * friction * force
    if needed > max(held, force):
        grip = f"{held:.1f} N (2 x friction {friction:g} x {force:g} N)"
        problems.append(f"the pads of '{name}' hold {grip}, and {needed:.1f} N are needed")
    return " and ".join(problems)


def sliding_problem(body: Body, name: str, model: RobotModel) -> str:
    """Why a robot cannot slide a body on its support; empty if its weight does not exclude it.

    The arm pushes with at most the weight of its payload. Arguments as of :func:`lifting_problem`.
    """
    if model.payload is None:
        return ""
    needed, allowed = body.friction * body.mass * GRAVITY, model.payload * GRAVITY
    if needed <= allowed:
        return ""
    return (
        f"sliding it takes {needed:.1f} N (friction {body.friction:g} x {body.mass * GRAVITY:.1f} N), and '{name}' "
        f"pushes with at most {allowed:.1f} N (payload {model.payload:g} kg)"
    )
