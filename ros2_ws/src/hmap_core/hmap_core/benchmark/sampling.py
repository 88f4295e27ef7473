"""Random configurations, bodies and contacts for instances, from the judge's kinematics and geometry only.

The compared solvers do not influence which instances are chosen. If an instance needs certain configurations to be
feasible, this module finds them by damped least squares from many random starts (Wampler, "Manipulator inverse
kinematic solutions based on vector formulations and damped least-squares methods", IEEE Trans. SMC 1986), and the
judge checks that they are free.
"""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import Attachment
from hmap_core.benchmark.world import clearance, robot_data
from hmap_core.contacts.surface import sample_surface
from hmap_core.kinematics.arm import load_arm
from hmap_core.transforms import from_matrix, interpolate, multiply, pose
from hmap_core.types import Body, BodyKind, Robot, Scene
from hmap_core.validation import arm, rigid

LIMIT_SHARE = 0.05  # share of the joint range at both ends in which no configuration is drawn
IK_STARTS = 64
IK_ITERATIONS = 60
IK_DAMPING = 1e-3
IK_MAX_STEP = 0.4  # rad, of one joint in one iteration
IK_TOLERANCE = 1e-6  # m and rad
MAX_JOINT_STEP = 0.2  # rad; largest change of a joint between successive poses of a path
# numbers of poses at which the object's straight path, and the straight approach, are checked
OBJECT_SAMPLES, APPROACH_SAMPLES = 12, 3
CONTACT_GAP = 0.0003  # m between a touching fingertip and the surface


def random_configuration(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """A random configuration (n,), uniform within the limits without their outermost parts."""
    lower, upper = robot.model.position_limits
    edge = LIMIT_SHARE * (upper - lower)
    return rng.uniform(lower + edge, upper - edge)


def end_effector(robot: Robot, q: np.ndarray) -> np.ndarray:
    """T_world_ee (7,) at q (n,)."""
    R, p = _frames(arm.build(robot_data(robot)), np.atleast_2d(q))[1:]
    return from_matrix(np.block([[R[0], p[0][:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))


def _frames(build: arm.Arm, Q: np.ndarray):
    frames = build.frames(build.values(Q, np.zeros(len(Q))))
    return frames, *build.end_effector(frames)


def configurations_at(robot: Robot, T_world_ee: np.ndarray, rng: np.random.Generator, near: np.ndarray | None = None):
    """Find configurations that reach an end-effector pose.

    Args:
        robot: the robot.
        T_world_ee: (7,) the pose.
        rng: draws the starts.
        near: (n,) one of the starts; default: the home configuration.

    Returns:
        Configurations (K, n) within the limits, sorted by their distance from ``near``; K can be 0.
    """
    near = robot.model.home if near is None else near
    Q = np.array([near, *(random_configuration(robot, rng) for _ in range(IK_STARTS - 1))])
    Q, reached = _inverse_kinematics(robot, T_world_ee, Q)
    Q = Q[reached]
    return Q[np.argsort(np.abs(Q - near).max(axis=1), kind="stable")]


def _inverse_kinematics(robot: Robot, T_world_ee: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (K, n) that iterations from Q (K, n) lead to, and whether the end-effector is at T_world_ee (7,),
    (K,).

    Damped least squares, clipped to the limits.
    """
    build = arm.build(robot_data(robot))
    lower, upper = robot.model.position_limits
    target_R, target_p = rigid.matrices(T_world_ee[3:]), T_world_ee[:3]
    joints = build.moving(build.data.end_effector_link)
    for _ in range(IK_ITERATIONS):
        frames, R, p = _frames(build, Q)
        if _reached(R, p, target_R, target_p).all():
            break
        E = np.swapaxes(R, 1, 2) @ target_R
        turn = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
        error = np.concatenate([target_p - p, (R @ turn[..., None])[..., 0]], axis=1)
        J = np.empty((len(Q), 6, len(joints)))
        for k, joint in enumerate(joints):
            axis = frames[joint.child][0] @ joint.axis
            J[:, :3, k] = np.cross(axis, p - frames[joint.child][1])
            J[:, 3:, k] = axis
        A = J @ np.swapaxes(J, 1, 2) + IK_DAMPING**2 * np.eye(6)
        step = (np.swapaxes(J, 1, 2) @ np.linalg.solve(A, error[..., None]))[..., 0]
        Q = np.clip(Q + np.clip(step, -IK_MAX_STEP, IK_MAX_STEP), lower, upper)
    _, R, p = _frames(build, Q)
    return Q, _reached(R, p, target_R, target_p)


def _reached(R: np.ndarray, p: np.ndarray, target_R: np.ndarray, target_p: np.ndarray) -> np.ndarray:
    off, turned = rigid.deviation(R, p, target_R, target_p)
    return (off < IK_TOLERANCE) & (turned < IK_TOLERANCE)


def _tracked(robot: Robot, Q: np.ndarray, targets: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (S, K, n) that reach S end-effector poses (7,) in turn from Q (K, n), and which can (K,).

    No joint changes by more than MAX_JOINT_STEP between successive poses.
    """
    can, ways = np.ones(len(Q), bool), []
    for T in targets:
        there, reached = _inverse_kinematics(robot, T, Q)
        can &= reached & (np.abs(there - Q).max(axis=1) <= MAX_JOINT_STEP)
        Q = there
        ways.append(Q)
    return np.array(ways), can


def straight_push_is_free(
    scene: Scene,
    opening: float,
    attachment: Attachment,
    goal: np.ndarray,
    approach: float,
    rng: np.random.Generator,
    min_distance: float,
) -> bool:
    """Whether the robot can approach the object and move it straight to a goal.

    The proof is constructive: one of the configurations at the contact is free on the approach and along the object's
    path.

    Args:
        scene: the robot and the bodies.
        opening: of the gripper, m.
        attachment: robot, object and contact.
        goal: T_world_obj (7,).
        approach: length of the straight approach along the hand's z axis, m.
        rng: draws starts of the inverse kinematics.
        min_distance: required distance as in :func:`ends_are_free`, m.
    """
    robot, body = scene.robots[attachment.robot], scene.bodies[attachment.object]
    touching = _may_touch(scene, attachment)
    poses = [interpolate(body.pose, goal, share) for share in np.linspace(0.0, 1.0, OBJECT_SAMPLES)]
    back = [retracted(attachment.T_obj_ee, share * approach) for share in np.linspace(0.0, 1.0, APPROACH_SAMPLES)]
    Q = configurations_at(robot, multiply(body.pose, attachment.T_obj_ee), rng, robot.q)
    if not len(Q):
        return False
    led, can_lead = _tracked(robot, Q, [multiply(T, attachment.T_obj_ee) for T in poses])
    come, can_come = _tracked(robot, Q, [multiply(body.pose, T) for T in back])
    places = [*poses, *[body.pose] * len(back)]
    ways = np.concatenate([led, come])
    return any(
        all(
            _free(scene, opening, attachment, T, q, min_distance, touching)
            for T, q in zip(places, ways[:, k], strict=True)
        )
        for k in np.flatnonzero(can_lead & can_come)
    )


def _may_touch(scene: Scene, attachment: Attachment) -> set[frozenset[str]]:
    """The pairs that can touch: the robot's fingers and the object, and the object and fixed bodies."""
    robot, name = scene.robots[attachment.robot], attachment.object
    pairs = {frozenset((f"{robot.name}/{link}", name)) for link in robot.model.require_gripper().finger_links}
    return pairs | {frozenset((name, other)) for other in scene.bodies if scene.bodies[other].kind is BodyKind.FIXED}


def _free(
    scene: Scene, opening: float, attachment: Attachment, T: np.ndarray, q: np.ndarray, min_distance: float, touching
) -> bool:
    """Whether the robot at q (n,) keeps ``min_distance`` (m) from everything, with the object at T (7,)."""
    there = replace(scene, bodies=scene.bodies | {attachment.object: replace(scene.bodies[attachment.object], pose=T)})
    return clearance(there, {attachment.robot: opening}, {attachment.robot: q}, min_distance, touching) >= min_distance


def ends_are_free(
    scene: Scene,
    opening: float,
    attachment: Attachment,
    goal: np.ndarray,
    rng: np.random.Generator,
    min_distance: float,
) -> bool:
    """Whether the robot has free configurations with the object at its start and at a goal.

    Args:
        scene: the robot and the bodies.
        opening: of the gripper, m.
        attachment: robot, object and contact.
        goal: T_world_obj (7,).
        rng: draws starts of the inverse kinematics.
        min_distance: required distance (m) between all pairs, except fingers and object, and object and fixed bodies.
    """
    robot, body = scene.robots[attachment.robot], scene.bodies[attachment.object]
    touching = _may_touch(scene, attachment)
    near = robot.q
    for T in (body.pose, goal):
        for q in configurations_at(robot, multiply(T, attachment.T_obj_ee), rng, near):
            if _free(scene, opening, attachment, T, q, min_distance, touching):
                near = q
                break
        else:
            return False
    return True


def contact_pose(robot: Robot, point: np.ndarray, normal: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The pose of a hand whose closed fingers touch a surface.

    Args:
        robot: the robot.
        point: (3,) the touched point, object frame, m.
        normal: (3,) outward unit normal there.
        R: (3, 3) orientation of the hand, object frame.

    Returns:
        T_obj_ee (7,).
    """
    tips = load_arm(robot.model).finger_vertices(0.0) @ R.T
    origin = point + (CONTACT_GAP - (tips @ normal).min()) * normal
    return from_matrix(np.block([[R, origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))


def hand_axes(z: np.ndarray, roll: float) -> np.ndarray:
    """Rotation (3, 3) with the unit vector z (3,) as its third column, rotated about it by ``roll`` (rad)."""
    other = np.eye(3)[np.abs(z).argmin()]
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    return np.stack([np.cos(roll) * x + np.sin(roll) * y, -np.sin(roll) * x + np.cos(roll) * y, z], axis=1)


def surface_contact(robot: Robot, body: Body, rng: np.random.Generator) -> np.ndarray:
    """T_obj_ee (7,) at a random point of a body's surface, with the hand along the inward normal and a random roll."""
    points, normals = sample_surface(body.shapes, 1, rng)
    R = hand_axes(-normals[0], rng.uniform(-np.pi, np.pi))
    return contact_pose(robot, points[0], normals[0], R)


def retracted(T_obj_ee: np.ndarray, distance: float) -> np.ndarray:
    """A contact T_obj_ee (7,) with the hand moved back along its z axis by a distance (m)."""
    return multiply(T_obj_ee, pose((0.0, 0.0, -distance)))
