"""Random configurations, bodies and contacts for instances, found with the judge's kinematics and geometry only.

No solver that is compared has a hand in choosing the instances: what makes an instance feasible is a configuration
    that this
module finds by damped least squares from many random starts (Wampler 1986) and that the judge finds free.
"""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import Ride
from hmap_core.benchmark.world import clearance, robot_data
from hmap_core.contacts.surface import sample_surface
from hmap_core.kinematics.arm import load_arm
from hmap_core.transforms import from_matrix, interpolate, multiply, pose
from hmap_core.types import Body, BodyKind, Robot, Scene
from hmap_core.validation import arm, rigid

LIMIT_SHARE = 0.05  # of the joint range, at either end, in which no configuration is drawn
IK_STARTS = 64
IK_ITERATIONS = 60
IK_DAMPING = 1e-3
IK_MAX_STEP = 0.4  # rad, of one joint in one iteration
IK_TOLERANCE = 1e-6  # m and rad
MAX_JUMP = 0.2  # rad of a joint from one place to the next of a way
LED_PLACES, BACK_PLACES = 12, 3  # at which a straight way with the object, and one to the contact, is looked at
CONTACT_GAP = 0.0003  # m between a touching fingertip and the surface


def random_posture(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """A configuration (n,), uniform within the limits but for their outermost parts."""
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


def postures_at(robot: Robot, T_world_ee: np.ndarray, rng: np.random.Generator, near: np.ndarray | None = None):
    """Configurations (K, n) within the limits that bring the end-effector to T_world_ee (7,); K may be 0.

    Args:
        near: (n,) one of the starts, and the one that the answers are sorted by, nearest first; by default the home.
    """
    near = robot.model.home if near is None else near
    Q = np.array([near, *(random_posture(robot, rng) for _ in range(IK_STARTS - 1))])
    Q, reached = _brought_to(robot, T_world_ee, Q)
    Q = Q[reached]
    return Q[np.argsort(np.abs(Q - near).max(axis=1), kind="stable")]


def _brought_to(robot: Robot, T_world_ee: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (K, n) from those of Q (K, n) with the end-effector at T_world_ee (7,), and which are there (K,).

    Damped least squares, clipped to the limits.
    """
    build = arm.build(robot_data(robot))
    lower, upper = robot.model.position_limits
    target_R, target_p = rigid.matrices(T_world_ee[3:]), T_world_ee[:3]
    joints = [build.tree.joint_to(j.child) for j in build.moving(build.data.end_effector_link)]
    for _ in range(IK_ITERATIONS):
        frames, R, p = _frames(build, Q)
        if _are_at(R, p, target_R, target_p).all():
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
    return Q, _are_at(*_frames(build, Q)[1:], target_R, target_p)


def _are_at(R: np.ndarray, p: np.ndarray, target_R: np.ndarray, target_p: np.ndarray) -> np.ndarray:
    off, turned = rigid.deviation(R, p, target_R, target_p)
    return (off < IK_TOLERANCE) & (turned < IK_TOLERANCE)


def _followed(robot: Robot, Q: np.ndarray, targets: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (S, K, n) that bring the end-effector from Q (K, n) to S poses (7,) in turn, and which can (K,).

    Where no joint jumps by more than MAX_JUMP from one pose to the next.
    """
    can, ways = np.ones(len(Q), bool), []
    for T in targets:
        there, reached = _brought_to(robot, T, Q)
        can &= reached & (np.abs(there - Q).max(axis=1) <= MAX_JUMP)
        Q = there
        ways.append(Q)
    return np.array(ways), can


def straight_is_free(
    scene: Scene,
    opening: float,
    ride: Ride,
    goal: np.ndarray,
    approach: float,
    rng: np.random.Generator,
    min_distance: float,
) -> bool:
    """Whether the robot of a ride can come to the object, and carry it straight from its start to a goal (7,).

    A proof by example: one of the configurations at the contact, led back by ``approach`` (m) along the hand's z
        axis, and
    led on with the object. Free is as in :func:`ends_are_free`, at LED_PLACES and BACK_PLACES places.
    """
    robot, body = scene.robots[ride.robot], scene.bodies[ride.object]
    touching = _may_touch(scene, ride)
    poses = [interpolate(body.pose, goal, share) for share in np.linspace(0.0, 1.0, LED_PLACES)]
    back = [drawn_back(ride.T_obj_ee, share * approach) for share in np.linspace(0.0, 1.0, BACK_PLACES)]
    Q = postures_at(robot, multiply(body.pose, ride.T_obj_ee), rng, robot.q)
    if not len(Q):
        return False
    led, can_lead = _followed(robot, Q, [multiply(T, ride.T_obj_ee) for T in poses])
    come, can_come = _followed(robot, Q, [multiply(body.pose, T) for T in back])
    places = [*poses, *[body.pose] * len(back)]
    ways = np.concatenate([led, come])
    return any(
        all(_free(scene, opening, ride, T, q, min_distance, touching) for T, q in zip(places, ways[:, k], strict=True))
        for k in np.flatnonzero(can_lead & can_come)
    )


def _may_touch(scene: Scene, ride: Ride) -> set[frozenset[str]]:
    """Fingers and the object of a ride, and the object and what stands for good."""
    robot, name = scene.robots[ride.robot], ride.object
    pairs = {frozenset((f"{robot.name}/{link}", name)) for link in robot.model.gripper.finger_links}
    return pairs | {frozenset((name, other)) for other in scene.bodies if scene.bodies[other].kind is BodyKind.FIXED}


def _free(
    scene: Scene, opening: float, ride: Ride, T: np.ndarray, q: np.ndarray, min_distance: float, touching
) -> bool:
    """Whether the robot of a ride at q (n,) is ``min_distance`` (m) from everything, with the object at T (7,)."""
    there = replace(scene, bodies=scene.bodies | {ride.object: replace(scene.bodies[ride.object], pose=T)})
    return clearance(there, {ride.robot: opening}, {ride.robot: q}, min_distance, touching) >= min_distance


def ends_are_free(
    scene: Scene, opening: float, ride: Ride, goal: np.ndarray, rng: np.random.Generator, min_distance: float
) -> bool:
    """Whether the robot of a ride has free configurations with the object at its start and at a goal (7,).

    Free is ``min_distance`` (m) from everything, but for the fingers at the object and the object on what it stands on.
    """
    robot, body = scene.robots[ride.robot], scene.bodies[ride.object]
    touching = _may_touch(scene, ride)
    near = robot.q
    for T in (body.pose, goal):
        for q in postures_at(robot, multiply(T, ride.T_obj_ee), rng, near):
            if _free(scene, opening, ride, T, q, min_distance, touching):
                near = q
                break
        else:
            return False
    return True


def contact_pose(robot: Robot, point: np.ndarray, normal: np.ndarray, R: np.ndarray) -> np.ndarray:
    """T_obj_ee (7,) with closed fingers that touch a surface at a point (3,), and hand axes R (3, 3), object frame."""
    tips = load_arm(robot.model).finger_vertices(0.0) @ R.T
    origin = point + (CONTACT_GAP - (tips @ normal).min()) * normal
    return from_matrix(np.block([[R, origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))


def hand_axes(z: np.ndarray, roll: float) -> np.ndarray:
    """Rotation (3, 3) whose third column is the unit vector z (3,), turned about it by ``roll`` (rad)."""
    other = np.eye(3)[np.abs(z).argmin()]
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    return np.stack([np.cos(roll) * x + np.sin(roll) * y, -np.sin(roll) * x + np.cos(roll) * y, z], axis=1)


def surface_contact(robot: Robot, body: Body, rng: np.random.Generator) -> np.ndarray:
    """T_obj_ee (7,) at a random point of a body's surface, the hand along the inward normal, its roll random."""
    points, normals = sample_surface(body.shapes, 1, rng)
    R = hand_axes(-normals[0], rng.uniform(-np.pi, np.pi))
    return contact_pose(robot, points[0], normals[0], R)


def drawn_back(T_obj_ee: np.ndarray, distance: float) -> np.ndarray:
    """A contact (7,) with the hand moved back along its z axis by a distance (m)."""
    return multiply(T_obj_ee, pose((0.0, 0.0, -distance)))
