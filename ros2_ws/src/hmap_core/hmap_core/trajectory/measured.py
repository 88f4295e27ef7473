"""The measured state of a world, freed of what is noise: what a new plan can start from.

Bodies at rest are found a fraction of a millimetre inside of what carries them and a fraction of a degree tilted, and
joints a little beside where they are held. Where that is all, the planned value is the better one: it is known to be
stable and free. What has really changed stays as it was measured.
"""

import numpy as np

from hmap_core.trajectory.measured_limits import within_limits
from hmap_core.trajectory.samples import movable_bodies
from hmap_core.transforms import pose, quaternion_multiply
from hmap_core.types import Scene, SceneState

HEIGHT_NOISE = 0.001  # m of height that a body may be off where it is planned
TILT_NOISE = float(np.deg2rad(0.5))  # rad of tilt, likewise
JOINT_NOISE = 0.01  # rad that a joint may be off where it is held, as much as controllers accept at a goal
OPENING_NOISE = 0.001  # m that fingers may be off where they are held


def without_noise(scene: Scene, measured: SceneState, planned: SceneState) -> SceneState:
    """The measured state, with the planned value wherever the two differ by no more than noise.

    Of a body these are height and tilt, if both are noise; its place and its turn about the vertical stay as measured.
    Fixed bodies are where the scene has them. Joints and fingers that are beyond a limit by no more than a measurement
    may be are on it.

    Raises:
        InputError: a joint or a finger is farther beyond its limits.
    """
    poses = {name: body.pose.copy() for name, body in scene.bodies.items()}
    for name in set(movable_bodies(scene)) & measured.poses.keys():
        known = planned.poses.get(name)
        poses[name] = measured.poses[name].copy() if known is None else upright(measured.poses[name], known)
    q, gripper = {}, {}
    for name in scene.robots:
        near = np.abs(measured.q[name] - planned.q[name]) <= JOINT_NOISE
        q[name] = np.where(near, planned.q[name], measured.q[name])
        opening = measured.gripper[name]
        gripper[name] = planned.gripper[name] if abs(opening - planned.gripper[name]) <= OPENING_NOISE else opening
    return within_limits(scene, SceneState(q, gripper, poses))[0]


def upright(T_measured: np.ndarray, T_planned: np.ndarray) -> np.ndarray:
    """A measured pose (7,) with the planned height and tilt, where it differs from them by no more than noise."""
    x, y, z, w = quaternion_multiply(T_measured[3:], T_planned[3:] * [-1.0, -1.0, -1.0, 1.0])
    tilt = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w))
    if not (abs(T_measured[2] - T_planned[2]) <= HEIGHT_NOISE and tilt <= TILT_NOISE):
        return T_measured.copy()
    turn = np.array([0.0, 0.0, z, w]) / np.hypot(z, w)  # the part about the vertical (swing and twist)
    return pose([*T_measured[:2], T_planned[2]], quaternion_multiply(turn, T_planned[3:]))
