"""Coming to rest on the way: the rest of a stretch, ever slower along its own path, within the joints' limits."""

from dataclasses import dataclass

import numpy as np

from hmap_core.execution.stretches import Stretch, joint_trajectory
from hmap_core.trajectory.spline import CubicSpline
from hmap_core.types import JointTrajectory, Plan

PERIOD = 0.02  # s between the samples of a stop
SHARE = 0.9  # of the acceleration limits that is used
HELD_SHARE = 0.2  # the same with something in the fingers, so that friction holds it
SHORTEST, GROWTH, LONGEST = 0.04, 1.25, 5.0  # s a stop takes: the first that is tried, how it grows, the last


@dataclass(frozen=True)
class Halt:
    """A stop of all robots that move in a stretch.

    Attributes:
        began: planned time (s) up to which the plan is still followed.
        rests: planned time (s) of the place on the path where everything comes to rest.
        motions: robot -> its motion; times are in seconds from the start of the stretch, from ``began`` on.
    """

    began: float
    rests: float
    motions: dict[str, JointTrajectory]


def halt(plan: Plan, stretch: Stretch, at: float) -> Halt:
    """The stop that begins at the planned time ``at`` (s), along the path, with constant deceleration.

    Where the stretch ends sooner than the robots could stop, it is followed to its end, where they rest anyway.
    """
    time = plan.trajectory.time
    start, end = float(time[stretch.first]), float(time[stretch.last])
    at = float(np.clip(at, start, end))
    curves = {robot: _curve(plan, robot, stretch) for robot in plan.scene.robots}
    duration, share = SHORTEST, HELD_SHARE if stretch.held else SHARE
    while at + 0.5 * duration < end and duration < LONGEST:
        motions = {robot: _slowed(curve, at - start, duration) for robot, curve in curves.items()}
        limits = {robot: plan.scene.robots[robot].model.acceleration_limits for robot in motions}
        if all(_within(motion, share * limits[robot]) for robot, motion in motions.items()):
            rests = at + 0.5 * duration
            break
        duration *= GROWTH
    else:
        motions = {robot: _rest_of(curve, at - start, end - start) for robot, curve in curves.items()}
        rests = end
    names = {robot: placed.model.joint_names for robot, placed in plan.scene.robots.items()}
    return Halt(at, rests, {robot: JointTrajectory(names[robot], *motion) for robot, motion in motions.items()})


def _curve(plan: Plan, robot: str, stretch: Stretch) -> CubicSpline:
    """The motion that the robot's controller follows: joint positions (n,) at seconds from the start of the stretch."""
    motion = joint_trajectory(plan, robot, stretch)
    return CubicSpline(motion.times, motion.positions, motion.require_velocities())


def _slowed(curve: CubicSpline, at: float, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,), positions (N, n) and velocities (N, n) of the curve run through ever slower from ``at`` on."""
    t = np.append(np.arange(0.0, duration - 0.5 * PERIOD, PERIOD), duration)
    s = at + t - 0.5 * t**2 / duration
    rate = 1.0 - t / duration
    return at + t, curve(s), curve(s, 1) * rate[:, None]


def _rest_of(curve: CubicSpline, at: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.append(np.arange(at, end - 0.5 * PERIOD, PERIOD), end)
    velocities = curve(t, 1)
    velocities[-1] = 0.0
    return t, curve(t), velocities


def _within(motion: tuple[np.ndarray, np.ndarray, np.ndarray], limits: np.ndarray) -> bool:
    times, _, velocities = motion
    acceleration = np.diff(velocities, axis=0) / np.diff(times)[:, None]
    return bool((np.abs(acceleration) <= limits).all())
