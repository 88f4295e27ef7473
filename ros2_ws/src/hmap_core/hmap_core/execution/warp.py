"""Motions that run at another rate than planned: slower, ever slower to a stop, or faster again, along their path."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core.trajectory.spline import CubicSpline
from hmap_core.types import JointTrajectory

PERIOD = 0.02  # s between the samples of a ramp
SHARE = 0.9  # of the acceleration limits that is used
HELD_SHARE = 0.2  # the same with something in the fingers, so that friction holds it
SHORTEST, GROWTH, LONGEST = 0.04, 1.25, 5.0  # s a ramp takes: the first that is tried, how it grows, the last
SAME_TIME = 1e-6  # s
STANDS = 0.3  # s that the end of a stop is held, so that a stop which comes late is still taken


@dataclass(frozen=True)
class Warp:
    """Seconds into a motion over seconds of the controllers' clock: one rate, a linear ramp, then another rate.

    Attributes:
        begin: s of the clock at which the ramp begins.
        at: s into the motion there.
        before, after: rates, s of the motion per s of the clock.
        ramp: s of the clock that it takes.
    """

    begin: float = 0.0
    at: float = 0.0
    before: float = 1.0
    after: float = 1.0
    ramp: float = 0.0

    @property
    def settled(self) -> float:
        """Seconds into the motion at the end of the ramp."""
        return self.at + 0.5 * (self.before + self.after) * self.ramp

    def rate(self, t: float | np.ndarray) -> np.ndarray:
        """Rates (...) at times (...) of the clock."""
        share = np.clip((t - self.begin) / self.ramp, 0.0, 1.0) if self.ramp else 1.0 * (np.asarray(t) >= self.begin)
        return self.before + share * (self.after - self.before)

    def into(self, t: float | np.ndarray) -> np.ndarray:
        """Seconds (...) into the motion at times (...) of the clock."""
        since = np.asarray(t, float) - self.begin
        u = np.clip(since, 0.0, self.ramp)
        bend = 0.5 * (self.after - self.before) * u * u / self.ramp if self.ramp else 0.0
        return (
            self.at + self.before * (np.minimum(since, 0.0) + u) + bend + self.after * np.maximum(since - self.ramp, 0)
        )

    def clock(self, s: float) -> float:
        """The time of the clock at which it is ``s`` seconds into the motion, before or after the ramp or in it."""
        way = s - self.at
        if way <= 0.0:
            return self.begin + (way / self.before if self.before else 0.0)
        if s >= self.settled:
            return self.begin + self.ramp + ((s - self.settled) / self.after if self.after else 0.0)
        bend = (self.after - self.before) / self.ramp
        return self.begin + 2.0 * way / (self.before + float(np.sqrt(max(0.0, self.before**2 + 2.0 * bend * way))))


def constant(rate: float) -> Warp:
    """One rate from the begin to the end."""
    return Warp(before=rate, after=rate)


def ramp_to(
    rate: float,
    motions: Mapping[str, JointTrajectory],
    limits: Mapping[str, np.ndarray],
    old: Warp,
    begin: float,
    share: float,
) -> Warp | None:
    """The shortest ramp to another rate that keeps the joints' accelerations small.

    A stop keeps to ``share`` of the limits, or to what the motion itself needs elsewhere if that is more: it was
    planned for what is held. Another ramp adds at most as much to what the motion itself needs.

    Args:
        rate: at the end of the ramp; 0: a stop.
        motions: robot -> its motion.
        limits: robot -> acceleration limits (n,), rad/s^2.
        old: at which the motions run.
        begin: s of the clock at which the ramp begins.
        share: of the limits that is used.

    Returns:
        the warp; None where the motions end sooner than they could stop.
    """
    end = max(float(motion.times[-1]) for motion in motions.values())
    at, before = float(old.into(begin)), float(old.rate(begin))
    curves = {robot: curve_of(motion) for robot, motion in motions.items()}
    duration = SHORTEST
    while duration < LONGEST:
        warp = Warp(begin, at, before, rate, duration)
        if rate == 0.0 and warp.settled >= end:
            return None
        if all(_within(curve, warp, share * limits[robot]) for robot, curve in curves.items()):
            return warp
        duration *= GROWTH
    return None if rate == 0.0 else Warp(begin, at, before, rate, LONGEST)


def warped(motion: JointTrajectory, warp: Warp) -> JointTrajectory:
    """A motion from the begin of a warp's ramp on; its times are those of the clock."""
    if warp == constant(1.0):
        return motion
    curve, end = curve_of(motion), float(motion.times[-1])
    ramp = _ramp_times(warp)
    inside = warp.into(ramp) < end - SAME_TIME
    if warp.after:
        gap = 0.5 * PERIOD * warp.after if warp.ramp else SAME_TIME
        later = motion.times[motion.times > warp.settled + gap]
        if not len(later):
            later = np.array([end])
        t = np.concatenate([ramp[inside], [warp.clock(s) for s in later]])
        s = np.concatenate([warp.into(ramp[inside]), later])
    else:
        t, s = np.append(ramp, ramp[-1] + STANDS), np.append(warp.into(ramp), warp.settled)
    velocities = curve(s, 1) * warp.rate(t)[:, None]
    velocities[-1] = 0.0
    efforts = None
    if motion.efforts is not None:
        efforts = np.stack([np.interp(s, motion.times, column) for column in np.asarray(motion.efforts).T], axis=1)
    return JointTrajectory(motion.names, t, curve(s), velocities, efforts)


def curve_of(motion: JointTrajectory) -> CubicSpline:
    """The curve (n,) over time (s) that a controller follows."""
    return CubicSpline(np.asarray(motion.times), np.asarray(motion.positions), motion.require_velocities())


def _ramp_times(warp: Warp) -> np.ndarray:
    steps = np.arange(0.0, warp.ramp - 0.5 * PERIOD, PERIOD) if warp.ramp else np.zeros(0)
    return warp.begin + np.append(steps, warp.ramp)


def _within(curve: CubicSpline, warp: Warp, limits: np.ndarray) -> bool:
    t = _ramp_times(warp)
    s = np.minimum(warp.into(t), curve.x[-1])
    acceleration = np.diff(curve(s, 1) * warp.rate(t)[:, None], axis=0) / np.diff(t)[:, None]
    if warp.after == 0.0:
        allowed = np.maximum(limits, np.abs(curve(curve.x, 2)).max(axis=0))
    else:
        allowed = limits + np.abs(curve(s[:-1], 2)) * max(warp.before, warp.after) ** 2
    return bool((np.abs(acceleration) <= allowed).all())
