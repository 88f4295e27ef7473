"""How the weight of an object is shared by two grasps, and which pairs of grasps hold it.

Both hands push up on the object. Seen from above, the forces balance the weight and its moment about every point of the
line between the grasps, so each hand carries the share that the lever arms give (statics; cooperating arms without
internal forces: Uchiyama & Dauchez, *A symmetric hybrid position/force control scheme for the coordination of two
robots*, ICRA 1988). What is left is the moment about that line, which the pads resist little.
"""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.contacts.grip_force import LIFT_ACCELERATION, pad_friction, weight_ratio
from hmap_core.komo.shapes import body_set
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import rotation_matrices
from hmap_core.types import Body, ContactPoint, Robot, RobotModel

BESIDE = 0.015  # m that the centre of mass may be beside the line between two grasps, seen from above
LEAST_LEVER = 0.1  # m between two grasps, seen from above
PAYLOAD_SHARE = 0.98  # of an arm's payload, and of a gripper's force, that a share may use


def grasp_points(contacts: Sequence[ContactPoint], model: RobotModel) -> np.ndarray:
    """Middle between the pads (K, 3) of grasps, in the object's frame."""
    frames = np.array([contact.T_obj_ee for contact in contacts]).reshape(-1, 7)
    reach = np.array([model.require_gripper().reach_at(contact.opening) for contact in contacts])
    return frames[:, :3] + rotation_matrices(frames)[:, :, 2] * reach[:, None]


def load_shares(
    first: np.ndarray, second: np.ndarray, centre: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The share of a weight that the first of two grasps carries.

    Args:
        first, second: (K, 3) and (L, 3) grasp points.
        centre: (3,) centre of mass.
        up: (3,) vertical unit vector; all in the object's frame.

    Returns:
        The share (K, L) of the first grasp, 1 minus which the second one carries; the distance (K, L) of the centre
        of mass from the line between both, and the lever between both (K, L), seen from above, m.
    """
    level = np.eye(3) - np.outer(up, up)
    a, b, c = first @ level, second @ level, level @ centre
    between = b[None] - a[:, None]
    lever = np.linalg.norm(between, axis=2)
    along = between / np.maximum(lever, 1e-9)[:, :, None]
    to_centre = c - a[:, None]
    way = np.einsum("kli,kli->kl", np.broadcast_to(to_centre, between.shape), along)
    beside = np.linalg.norm(to_centre - way[:, :, None] * along, axis=2)
    return 1.0 - way / np.maximum(lever, 1e-9), beside, lever


def pairs_hold(
    body: Body,
    robots: tuple[Robot, Robot],
    contacts: tuple[Sequence[ContactPoint], Sequence[ContactPoint]],
    up: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Which pairs of grasps hold a lifted body by payload, grip force and lever arms.

    Args:
        body: what is lifted.
        robots: the two robots.
        contacts: K grasps of the first and L of the second.
        up: (3,) vertical unit vector in the body's frame.

    Returns:
        Whether each pair holds it (K, L), and the share (K, L) that the first robot carries.
    """
    points = [grasp_points(own, robot.model) for own, robot in zip(contacts, robots, strict=True)]
    share, beside, lever = load_shares(points[0], points[1], centre_of_mass(body_set(body)), up)
    holds = (beside <= BESIDE) & (lever >= LEAST_LEVER) & (share >= 0.0) & (share <= 1.0)
    used = (share, 1.0 - share)
    for k, (robot, own, part) in enumerate(zip(robots, contacts, used, strict=True)):
        ratio = weight_ratio(body, own, robot.model, up)
        holds &= part * (ratio[:, None] if k == 0 else ratio[None]) <= PAYLOAD_SHARE
        if robot.model.payload is not None:
            holds &= part * body.mass <= PAYLOAD_SHARE * robot.model.payload
    return holds, share


def capacity(body: Body, model: RobotModel) -> float:
    """The largest mass (kg) of a body that a robot can hold up, by payload and grip force; 0 without a gripper."""
    if model.gripper is None:
        return 0.0
    held = max(2.0 * pad_friction(body, model), 1.0) * model.gripper.force / (GRAVITY + LIFT_ACCELERATION)
    return float(held if model.payload is None else min(held, model.payload))
