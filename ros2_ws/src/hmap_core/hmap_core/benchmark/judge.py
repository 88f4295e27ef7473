"""The judge of motion instances. It shares no geometry, kinematics or tolerances with the solvers.

Joints are linear between two steps. Each interval is subdivided until no point of a robot, or of its attached
object, moves more than ``MOTION_BOUND`` in one part. Distances are measured at the ends of the parts; in between they
are bounded, and measured if necessary, as in :mod:`hmap_core.validation.collision`.
"""

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance
from hmap_core.benchmark.world import instance_world, nearest, pairs, robot_data
from hmap_core.validation import arm, collision, rigid
from hmap_core.validation.limits import LIMIT_RELATIVE, MOTION_BOUND, PENETRATION, START_JOINT
from hmap_core.validation.report import Findings

TARGET_POSITION = 1e-3  # m
TARGET_ROTATION = np.deg2rad(0.5)
SUPPORT_HEIGHT = 1e-3  # m; largest height of an object above its support
SUPPORT_TILT = np.deg2rad(0.5)


def judge(instance: MotionInstance, path: np.ndarray) -> list[str]:
    """Judge a path.

    Args:
        instance: the problem.
        path: (T + 1, n), with the start as the first row.

    Returns:
        The errors of the path, in words; empty if it solves the problem.
    """
    path = np.asarray(path, float)
    shape = (instance.steps + 1, len(instance.start))
    if path.shape != shape or not np.isfinite(path).all():
        return [f"a path of shape {path.shape} with numbers only is needed: {shape}"]
    found = []
    if np.abs(path[0] - instance.start).max() > START_JOINT:
        found.append("does not start where the robots stand")
    found += _limits(instance, path)
    found += _targets(instance, path)
    if not instance.path:
        return found + _configuration(instance, path[-1:])
    for phase in range(len(instance.steps_per_phase)):
        found += _phase(instance, path, phase)
    return found


def _arms(instance: MotionInstance) -> dict[str, arm.Arm]:
    return {name: arm.build(robot_data(robot)) for name, robot in instance.scene.robots.items()}


def _end_effector(robot: arm.Arm, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) and positions (N, 3) of the end-effector."""
    return robot.end_effector(robot.frames(robot.values(joints, np.zeros(len(joints)))))


def _limits(instance: MotionInstance, path: np.ndarray) -> list[str]:
    found = []
    for name, robot in instance.scene.robots.items():
        lower, upper = robot.model.position_limits
        slack = LIMIT_RELATIVE * (upper - lower)
        joints = path[1:, instance.columns(name)]
        beyond = np.maximum(lower - joints, joints - upper) - slack
        if beyond.max() > 0.0:
            step, joint = np.unravel_index(beyond.argmax(), beyond.shape)
            found.append(f"joint {joint + 1} of {name} beyond its limit at step {step + 1}")
    return found


def _targets(instance: MotionInstance, path: np.ndarray) -> list[str]:
    found = []
    arms = _arms(instance)
    for target in instance.targets:
        row = instance.last(target.phase) - target.before
        R, p = _end_effector(arms[target.robot], path[row : row + 1, instance.columns(target.robot)])
        off, turned = rigid.deviation(R, p, rigid.matrices(target.T_world_ee[3:]), target.T_world_ee[:3])
        if off[0] > TARGET_POSITION or turned[0] > TARGET_ROTATION:
            found.append(
                f"{target.robot} misses the target at step {row} "
                f"by {off[0] * 1e3:.2f} mm, {np.rad2deg(turned[0]):.2f} deg"
            )
    return found


def _configuration(instance: MotionInstance, q: np.ndarray) -> list[str]:
    world = instance_world(instance, q, {})
    deepest = nearest(world, pairs(world), -PENETRATION)
    return [f"something is {-deepest * 1e3:.2f} mm deep in something else"] if deepest < -PENETRATION else []


def _phase(instance: MotionInstance, path: np.ndarray, phase: int) -> list[str]:
    """The errors during one phase."""
    attachments = [attachment for attachment in instance.attachments if attachment.first <= phase]
    rows = path[instance.last(phase - 1) : instance.last(phase) + 1]
    joints = _refined(instance, rows, attachments)
    switches = {attachment.object: path[instance.last(attachment.first - 1)][None] for attachment in attachments}
    objects = {a.object: _attached_poses(instance, a, switches[a.object], joints) for a in attachments}
    world = instance_world(instance, joints, objects)
    resting = {frozenset((attachment.object, attachment.support)) for attachment in attachments}
    findings = Findings()
    among = [pair for pair in pairs(world) if np.any(pair.motion > 0.0) and frozenset(pair.names) not in resting]
    for pair in among:
        pair.clearance = False  # only violations are needed, no minimum distances
    collision.check(world, among, findings)
    found = [
        f"{' and '.join(v.bodies)} overlap by {v.amount * 1e3:.2f} mm in phase {phase}" for v in findings.violations()
    ]
    for attachment in attachments:
        if attachment.support is not None:
            found += _off_support(instance, attachment, objects[attachment.object], phase)
    return found


def _refined(instance: MotionInstance, rows: np.ndarray, attachments: list[Attachment]) -> np.ndarray:
    """Configurations (N, n) on straight lines between rows (M, n), so close that points move less than MOTION_BOUND."""
    motion = np.zeros(len(rows) - 1)
    for name, robot in _arms(instance).items():
        joints = rows[:, instance.columns(name)]
        values = robot.values(joints, np.full(len(joints), instance.opening[name]))
        frames = robot.frames(values)
        shapes = {shape.link for shape in robot.tree.shapes}
        reach = max(
            [float(np.linalg.norm(s.solid.points @ s.R.T + s.p, axis=1).max()) for s in robot.tree.shapes]
            + [_extent(instance, attachment) for attachment in attachments if attachment.robot == name]
        )
        links = sorted(shapes | {robot.data.end_effector_link})
        moved = [link.speed(reach) for link in robot.motions(links, values, frames).values()]
        motion = np.maximum(motion, np.max(moved, axis=0))
    pieces = np.maximum(1, np.ceil(motion / MOTION_BOUND).astype(int))
    parts = [
        a + np.arange(count)[:, None] / count * (b - a) for a, b, count in zip(rows, rows[1:], pieces, strict=False)
    ]
    return np.concatenate([*parts, rows[-1:]])


def _extent(instance: MotionInstance, attachment: Attachment) -> float:
    """Upper bound of the distance (m) from the end-effector's link to the attached object's farthest point."""
    body = instance.scene.bodies[attachment.object]
    size = max(float(np.linalg.norm(s.size) + np.linalg.norm(s.pose[:3])) for s in body.shapes)
    link = instance.scene.robots[attachment.robot].model.T_link_ee
    return size + float(np.linalg.norm(attachment.T_obj_ee[:3])) + float(np.linalg.norm(link[:3]))


def _attached_poses(
    instance: MotionInstance, attachment: Attachment, switch: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """Poses (N, 7) of an object attached since the configuration ``switch`` (1, n), with the robots at joints."""
    robot = _arms(instance)[attachment.robot]
    columns = instance.columns(attachment.robot)
    R0, p0 = _end_effector(robot, switch[:, columns])
    pose = instance.scene.bodies[attachment.object].pose
    R_held, p_held = rigid.relative(R0, p0, rigid.matrices(pose[None, 3:]), pose[None, :3])
    R, p = _end_effector(robot, joints[:, columns])
    return np.concatenate([p + R @ p_held[0], quaternions(R @ R_held[0])], axis=1)


def quaternions(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (N, 4) xyzw of rotations (N, 3, 3), neighbours in the same hemisphere.

    The eigenvector of the largest eigenvalue of Bar-Itzhack's symmetric matrix (J. Guidance 23(6), 2000).
    """
    K = np.empty((len(R), 4, 4))
    trace = np.trace(R, axis1=1, axis2=2)
    K[:, :3, :3] = R + np.swapaxes(R, 1, 2) - trace[:, None, None] * np.eye(3)
    K[:, :3, 3] = K[:, 3, :3] = np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
    )
    K[:, 3, 3] = trace
    q = np.linalg.eigh(K)[1][:, :, -1]
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    return q


def _off_support(instance: MotionInstance, attachment: Attachment, poses: np.ndarray, phase: int) -> list[str]:
    start = instance.scene.bodies[attachment.object].pose
    lifted = float(np.abs(poses[:, 2] - start[2]).max())
    up, up0 = rigid.matrices(poses[:, 3:])[:, 2], rigid.matrices(start[3:])[2]
    tilted = float(np.arcsin(np.minimum(1.0, np.linalg.norm(np.cross(up, up0), axis=1))).max())
    if lifted <= SUPPORT_HEIGHT and tilted <= SUPPORT_TILT:
        return []
    return [
        f"{attachment.object} leaves {attachment.support} by {lifted * 1e3:.2f} mm, {np.rad2deg(tilted):.2f} deg "
        f"in phase {phase}"
    ]
