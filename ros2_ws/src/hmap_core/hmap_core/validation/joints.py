"""Joint limits, rest at both ends, and jumps, from the uniform samples."""

from dataclasses import dataclass

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import World


@dataclass(frozen=True)
class JointTrack:
    """The trajectory of one joint, with its limits in rad or m, per s and per s^2."""

    bodies: tuple[str, str]  # robot, joint
    q: np.ndarray  # (N,)
    lower: float
    upper: float
    velocity: float
    acceleration: float


def tracks(world: World) -> list[JointTrack]:
    """The joints of all arms and fingers, with the narrower limits of plan and URDF."""
    found = []
    for name, robot in world.arms.items():
        d = robot.data
        of_urdf = {joint.name: joint for joint in robot.tree.joints}
        for i, joint_name in enumerate(d.joint_names):
            joint = of_urdf[joint_name]  # the narrower limits of plan and URDF count; a velocity of 0 is none
            low, high = max(d.position_limits[0, i], joint.lower), min(d.position_limits[1, i], joint.upper)
            v = min(d.velocity_limits[i], joint.velocity or np.inf)
            q, a = world.document.joints[name][:, i], d.acceleration_limits[i]
            found.append(JointTrack((name, joint_name), q, low, high, v, a))
        for joint in robot.tree.joints:
            if d.gripper is not None and joint.name in d.gripper.joint_names:
                q = world.values[name][joint.name]
                found.append(JointTrack((name, joint.name), q, joint.lower, joint.upper, joint.velocity, np.inf))
    return found


def _position(track: JointTrack, time: np.ndarray, findings: Findings) -> None:
    span = track.upper - track.lower
    slack = limits.ROUNDING + (limits.LIMIT_RELATIVE * span if np.isfinite(span) else 0.0)
    for bound, excess in ((track.lower, track.lower - track.q), (track.upper, track.q - track.upper)):
        k = int(excess.argmax())
        if excess[k] > slack:
            findings.add(Kind.JOINT_LIMIT, track.bodies, time[k], track.q[k], bound, excess[k])


def _velocity(track: JointTrack, time: np.ndarray, dt: float, findings: Findings) -> None:
    speed = np.abs(np.diff(track.q)) / dt
    k = int(speed.argmax())
    allowed = track.velocity * (1.0 + limits.LIMIT_RELATIVE) + limits.ROUNDING / dt
    if speed[k] > allowed:
        findings.add(Kind.VELOCITY_LIMIT, track.bodies, time[k], speed[k], track.velocity, speed[k])
    if speed[k] > limits.JUMP_FACTOR * allowed:
        findings.add(Kind.JUMP, track.bodies, time[k], speed[k] * dt, track.velocity * dt, speed[k])


def _acceleration(track: JointTrack, time: np.ndarray, dt: float, findings: Findings) -> None:
    """Checks second differences; the joint rests before the start and after the end."""
    q = np.concatenate([track.q[:1], track.q, track.q[-1:]])
    acceleration = np.abs(q[2:] - 2.0 * q[1:-1] + q[:-2]) / dt**2
    k = int(acceleration.argmax())
    allowed = track.acceleration * (1.0 + limits.LIMIT_RELATIVE) + 2.0 * limits.ROUNDING / dt**2
    if acceleration[k] > allowed:
        bodies, limit = track.bodies, track.acceleration
        findings.add(Kind.ACCELERATION_LIMIT, bodies, time[k], acceleration[k], limit, acceleration[k])


def end_velocity(q: np.ndarray, dt: float) -> float:
    """Speed of a joint at its first sample: the smaller of two one-sided differences.

    The first-order difference is at most a dt / 2 for a joint that starts from rest with acceleration a. The
    second-order difference is zero for constant a. If the acceleration begins inside the first step, the smaller one is
    at most 0.24 a dt.

    Args:
        q: (N,) positions, rad or m.
        dt: time step, s.

    Returns:
        The speed, rad/s or m/s.
    """
    first = abs(q[1] - q[0]) / dt
    if len(q) < 3:
        return first
    return min(first, abs(-3.0 * q[0] + 4.0 * q[1] - q[2]) / (2.0 * dt))


def _rest(track: JointTrack, time: np.ndarray, dt: float, findings: Findings) -> None:
    if not np.isfinite(track.acceleration):
        return
    allowed = limits.REST_VELOCITY * track.acceleration * dt + 2.0 * limits.ROUNDING / dt
    for q, instant in ((track.q, time[0]), (track.q[::-1], time[-1])):
        findings.check(Kind.NOT_AT_REST, track.bodies, instant, end_velocity(q, dt), allowed)


def _start(world: World, findings: Findings) -> None:
    for name, robot in world.arms.items():
        off = np.abs(world.document.joints[name][0] - robot.data.q_start)
        i = int(off.argmax())
        findings.check(Kind.START_MISMATCH, (name, robot.data.joint_names[i]), 0.0, off[i], limits.START_JOINT)


def check(world: World, findings: Findings) -> None:
    """Reports joints that violate a limit, jump, start elsewhere, or do not rest at both ends."""
    time, dt = world.document.time, world.document.dt
    _start(world, findings)
    for track in tracks(world):
        _position(track, time, findings)
        _velocity(track, time, dt, findings)
        _acceleration(track, time, dt, findings)
        _rest(track, time, dt, findings)
