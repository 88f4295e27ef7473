"""Motion of the bodies: start pose, jumps, motion without contact, and the goal."""

import numpy as np

from hmap_core.validation import limits, rigid
from hmap_core.validation.contacts import Contact, runs, touched_steps
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import World


def deviation(poses: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N,) in metres and angles (N,) in radians of poses (N, 7) from a pose (7,)."""
    return np.linalg.norm(poses[:, :3] - pose[:3], axis=1), rigid.angle_between(poses[:, 3:], pose[None, 3:])


def _check_start(world: World, findings: Findings) -> None:
    for name, body in world.document.bodies.items():
        distance, angle = (float(value[0]) for value in deviation(world.poses[name][:1], body.pose))
        findings.check(Kind.START_MISMATCH, (name,), 0.0, distance, limits.START_POSITION)
        findings.check(Kind.START_MISMATCH, (name,), 0.0, np.degrees(angle), np.degrees(limits.START_ROTATION))


def _check_jumps(world: World, findings: Findings) -> None:
    dt = world.document.dt
    for name in world.document.objects:
        poses = world.poses[name]
        travel = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        turned = np.degrees(rigid.angle_between(poses[:-1, 3:], poses[1:, 3:]))
        for amount, rate in ((travel, limits.OBJECT_SPEED), (turned, np.degrees(limits.OBJECT_TURN_RATE))):
            k = int(amount.argmax())
            findings.check(Kind.JUMP, (name,), world.document.time[k], amount[k], rate * dt)


def _check_untouched(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Checks that an object keeps the pose at which the last contact ended."""
    for name in world.document.objects:
        for first, last in runs(~touched_steps(world, contacts, name)):
            distance, angle = deviation(world.poses[name][first : last + 1], world.poses[name][first])
            for amount, limit in (
                (distance, limits.UNTOUCHED_POSITION),
                (np.degrees(angle), np.degrees(limits.UNTOUCHED_ROTATION)),
            ):
                beyond = amount > limit
                if beyond.any():
                    begin = world.document.time[first + int(beyond.argmax())]
                    findings.check(Kind.UNTOUCHED_MOTION, (name,), begin, amount.max(), limit)


def goal_error(world: World) -> tuple[float, float]:
    """Distance of the goal's object from its goal at the end of the plan: metres and radians."""
    goal = world.document.goal
    distance, angle = deviation(world.poses[goal.object][-1:], goal.pose)
    return float(distance[0]), float(angle[0])


def check_goal(world: World, findings: Findings) -> dict[str, float]:
    """Reports a missed goal.

    Returns:
        The error as in the report: ``position_m`` and ``rotation_deg``.
    """
    goal, end = world.document.goal, world.document.time[-1]
    distance, angle = goal_error(world)
    findings.check(Kind.GOAL_MISSED, (goal.object,), end, distance, goal.position_tolerance)
    findings.check(Kind.GOAL_MISSED, (goal.object,), end, np.degrees(angle), np.degrees(goal.rotation_tolerance))
    return {"position_m": distance, "rotation_deg": float(np.degrees(angle))}


def check(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Reports bodies that start elsewhere, jump, or move without contact."""
    _check_start(world, findings)
    _check_jumps(world, findings)
    _check_untouched(world, contacts, findings)
