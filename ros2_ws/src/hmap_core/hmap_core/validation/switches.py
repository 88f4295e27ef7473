"""What a robot does where its contact mode changes: the arm rests, and the gripper is no faster than it can be."""

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.document import SegmentData
from hmap_core.validation.joints import end_velocity, tracks
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import World

GRIPPER = "gripper"  # in reports, in place of a joint


def check(world: World, findings: Findings) -> None:
    """Reports arms that move at a mode switch, and grippers that are faster than the file allows."""
    _check_rest(world, findings)
    for name, robot in world.arms.items():
        if robot.data.gripper is not None:
            _check_speed(world, name, robot.data.gripper.speed, findings)


def _check_rest(world: World, findings: Findings) -> None:
    """Checks that all joints of an arm rest at its mode switches; both ends of the plan are checked elsewhere."""
    dt = world.document.dt
    switches = {name: _switches(world, name) for name in world.arms}
    for track in tracks(world):
        if not np.isfinite(track.acceleration):
            continue
        allowed = limits.REST_VELOCITY * track.acceleration * dt + 2.0 * limits.ROUNDING / dt
        for k in switches[track.bodies[0]]:
            speed = min(end_velocity(track.q[k:], dt), end_velocity(track.q[k::-1], dt))
            findings.check(Kind.NOT_AT_REST, track.bodies, world.document.time[k], speed, allowed)


def _switches(world: World, robot: str) -> list[int]:
    """The samples at which a robot's contact mode changes, both ends of the plan excluded."""
    own = [segment for segment in world.document.segments if segment.robot == robot]
    begins = {segment.first: _mode(segment) for segment in own}
    ends = {segment.last: _mode(segment) for segment in own}
    inner = (begins.keys() | ends.keys()) - {0, world.samples - 1}
    return sorted(k for k in inner if begins.get(k) != ends.get(k))


def _mode(segment: SegmentData) -> tuple[str, str, str | None]:
    return segment.kind, segment.manipulator, segment.object


def _check_speed(world: World, robot: str, limit: float, findings: Findings) -> None:
    speed = np.abs(np.diff(world.document.gripper[robot])) / world.document.dt
    k = int(speed.argmax())
    allowed = limit * (1.0 + limits.LIMIT_RELATIVE) + limits.ROUNDING / world.document.dt
    if speed[k] > allowed:
        findings.add(Kind.VELOCITY_LIMIT, (robot, GRIPPER), world.document.time[k], speed[k], limit, speed[k])
