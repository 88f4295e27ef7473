"""Time-optimal timing of a joint path under velocity and acceleration limits.

The geometry is a natural cubic spline over the joint-space chord length, kept within the position limits
(:func:`spline`); the speed along it comes
from TOPPRA (Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", T-RO
2018).
The result is stretched to a whole number of sampling periods, so that pieces join on one uniform grid.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hmap_core.exceptions import MotionError
from hmap_core.trajectory.path_speed import fastest_speed
from hmap_core.trajectory.spline import CubicSpline, natural_spline

DUPLICATE_DISTANCE = 1e-6  # rad; points closer than this to the last kept one are one point
LIMIT_MARGIN = 0.99  # share of the limits used in planning the speed; the rest covers what happens between grid points
GRID_INTERVALS = 64  # of the path parameter, spread over the spline's pieces by length
GRID_RETRIES = (1, 4)  # factors on GRID_INTERVALS that are tried in turn
SPLINES_KEPT = 16  # a path is verified on the curve on which it is then timed
LIMIT_ROUNDING = 1e-3  # rad or m that a point of a path may be beyond a position limit, as solvers are not exact
POINT_STEP = 1e-3  # of the path's length, step of the difference quotients of a carried point
STILL = 1e-9  # m/rad; a point that moves less along the path is still
TANGENTIAL, NORMAL = 0.8, 0.6  # shares of a point's acceleration along its path and across it; squares sum to one
STRETCH_ROUNDS = 20  # corrections of the duration when samples still exceed a limit


@dataclass(frozen=True)
class TimedPath:
    """A joint motion sampled uniformly, at rest at both ends.

    Attributes:
        time: (N,) s, multiples of the sampling period from 0.
        q: (N, n) joint positions, rad (m for prismatic joints).
        qd: (N, n) joint velocities; exactly zero in the first and the last row.
    """

    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1])


@dataclass(frozen=True)
class PointLimits:
    """Limits of a point that moves with a robot.

    Attributes:
        position: gives its positions (N, 3), m, at configurations (N, n).
        speed: m/s, at most.
        acceleration: m/s^2, magnitude, at most.
    """

    position: Callable[[np.ndarray], np.ndarray]
    speed: float
    acceleration: float


def distinct_points(path: np.ndarray) -> np.ndarray:
    """The path (M, n) without repeated points; its first and last point are kept exactly."""
    if len(path) > 1 and np.linalg.norm(np.diff(path, axis=0), axis=1).min() > DUPLICATE_DISTANCE:
        return path
    kept = [0]
    for i in range(1, len(path)):
        if np.linalg.norm(path[i] - path[kept[-1]]) > DUPLICATE_DISTANCE:
            kept.append(i)
    last = len(path) - 1
    if kept[-1] != last and not np.array_equal(path[kept[-1]], path[last]):
        # the end replaces the point it nearly repeats, unless that is the start
        kept = [0, last] if len(kept) == 1 else [*kept[:-1], last]
    return path[kept]


def spline(path: np.ndarray, position_limits: np.ndarray | None = None) -> CubicSpline:
    """The curve that :func:`time_parameterise` follows through a path (M, n).

    A natural spline; where that leaves the position limits between two points, with smaller slopes
    (:meth:`CubicSpline.within`).

    Args:
        path: (M, n) joint positions.
        position_limits: (2, n) lower and upper, which the whole curve keeps; points that are beyond them by no more
            than LIMIT_ROUNDING are moved onto them. None: there are none.

    Returns:
        The curve from the chord length s in [0, L] (rad) to joint positions (n,); its knots are ``.x``, so L is
        ``.x[-1]``. A path of one point gives the constant curve on [0, 1].

    Raises:
        MotionError: the path is empty, not a matrix, not finite, or beyond the limits.
    """
    path = np.ascontiguousarray(_checked_path(path))
    if position_limits is None:
        return _spline(path.tobytes(), path.shape[1], b"")
    return _spline(path.tobytes(), path.shape[1], _checked_positions(path, position_limits).tobytes())


@lru_cache(maxsize=SPLINES_KEPT)
def _spline(path: bytes, joints: int, position_limits: bytes) -> CubicSpline:
    points = np.frombuffer(path).reshape(-1, joints)
    limits = np.frombuffer(position_limits).reshape(-1, joints)  # none, or lower and upper
    points = distinct_points(np.clip(points, *limits) if len(limits) else points)
    if len(points) == 1:
        return natural_spline(np.array([0.0, 1.0]), np.repeat(points, 2, axis=0))
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    curve = natural_spline(chord, points)
    return curve.within(*limits) if len(limits) else curve


def time_parameterise(
    path: np.ndarray,
    velocity_limits: np.ndarray,
    acceleration_limits: np.ndarray,
    dt: float,
    position_limits: np.ndarray | None = None,
    carried: PointLimits | None = None,
) -> TimedPath:
    """The fastest motion along ``spline(path, position_limits)`` under the limits, from rest to rest, sampled every
    ``dt``.

    First and second finite differences of the samples stay within the limits, also where a piece that rests there is
    joined on before or after.

    Args:
        path: (M, n) joint positions, M >= 1. A single point, or equal ones, give one sample at time 0.
        velocity_limits: (n,) rad/s, positive.
        acceleration_limits: (n,) rad/s^2, positive.
        dt: sampling period, s.
        position_limits: (2, n) lower and upper, which all samples keep; None: there are none.
        carried: limits of a point that moves along, such as the centre of mass of what the robot carries.

    Raises:
        MotionError: wrong input, a point beyond the position limits, or no timing exists.
    """
    path = _checked_path(path)
    if position_limits is not None:
        position_limits = _checked_positions(path, position_limits)
        path = np.clip(path, *position_limits)
    velocity_limits = _checked_limits("velocity", velocity_limits, path.shape[1])
    acceleration_limits = _checked_limits("acceleration", acceleration_limits, path.shape[1])
    if not (np.isfinite(dt) and dt > 0.0):
        raise MotionError(f"the sampling period is {dt} s; it has to be positive")
    if len(distinct_points(path)) == 1:
        return TimedPath(np.zeros(1), path[:1].copy(), np.zeros_like(path[:1]))
    curve = spline(path, position_limits)
    profile = _speed_profile(curve, LIMIT_MARGIN * velocity_limits, LIMIT_MARGIN * acceleration_limits, carried)
    steps = max(1, int(np.ceil(profile.time[-1] / dt)))
    for _ in range(STRETCH_ROUNDS):
        timed = _sample(curve, profile, steps, dt, path[0], path[-1])
        if position_limits is not None:
            np.clip(timed.q, *position_limits, out=timed.q)  # rounding
        excess = _limit_excess(timed.q, velocity_limits, acceleration_limits, dt)
        if excess <= 1.0:
            return timed
        steps = max(steps + 1, int(np.ceil(steps * excess)))
    raise MotionError(f"the timing of a path of {len(path)} points still exceeds a limit {excess:.3f} times")


@dataclass(frozen=True)
class _Profile:
    """Speed along the curve: (K,) instants, parameters, speeds; (K - 1,) constant accelerations between them."""

    time: np.ndarray
    s: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


def _checked_path(path: np.ndarray) -> np.ndarray:
    path = np.asarray(path, float)
    if path.ndim != 2 or 0 in path.shape:
        raise MotionError(f"a joint path has the shape (points, joints), both at least 1; this one has {path.shape}")
    if not np.isfinite(path).all():
        row, column = np.argwhere(~np.isfinite(path))[0]
        raise MotionError(f"point {row} of the path is {path[row, column]} at joint {column}; it has to be finite")
    return path


def _checked_positions(path: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """The position limits (2, n) of a path that is within them but for LIMIT_ROUNDING."""
    limits = np.ascontiguousarray(limits, float)
    if limits.shape != (2, path.shape[1]) or not (limits[0] <= limits[1]).all():
        raise MotionError(
            f"the position limits are {limits.tolist()}; lower and upper of {path.shape[1]} joints needed"
        )
    excess = np.maximum(limits[0] - path, path - limits[1])
    if excess.max() > LIMIT_ROUNDING:
        point, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        allowed = f"{limits[0, joint]:.4f} to {limits[1, joint]:.4f}"
        raise MotionError(
            f"point {point} of the path has joint {joint + 1} at {path[point, joint]:.4f}; allowed: {allowed}"
        )
    return limits


def _checked_limits(name: str, limits: np.ndarray, joints: int) -> np.ndarray:
    limits = np.asarray(limits, float)
    if limits.shape != (joints,) or not (np.isfinite(limits).all() and (limits > 0.0).all()):
        raise MotionError(f"the {name} limits are {limits}; {joints} positive numbers are needed")
    return limits


def _speed_profile(
    curve: CubicSpline, velocity_limits: np.ndarray, acceleration_limits: np.ndarray, carried: PointLimits | None
) -> _Profile:
    """TOPPRA on the curve scaled to unit length and to a unit of time in which the limits are of order one.

    With u = s / L and t = tau * sqrt(L / a) the path is q / L, the velocity limit v / sqrt(L a) and the acceleration
    limit 1, whatever the length: the solver's absolute tolerances mean the same for a path of a degree and of a turn.
    """
    length = float(curve.x[-1])
    unit = np.sqrt(length / acceleration_limits.max())  # s
    velocity = velocity_limits * unit / length
    acceleration = acceleration_limits * unit**2 / length
    for factor in GRID_RETRIES:
        grid = _grid(curve.x / length, factor * GRID_INTERVALS)
        first, second = curve(grid * length, 1), curve(grid * length, 2) * length
        rows = [first, second, velocity, acceleration, np.full(len(grid), np.inf)]
        if carried is not None:
            rows = _with_point(curve, grid * length, rows, carried, unit)
        speed = fastest_speed(grid, *rows)
        if speed is not None and (speed[1:] + speed[:-1] > 0.0).all():
            return _profile(grid * length, speed * length / unit)
    raise MotionError(f"TOPPRA finds no timing for a path of {len(curve.x)} points and length {length:.6g} rad")


def _with_point(
    curve: CubicSpline, s: np.ndarray, rows: list[np.ndarray], carried: PointLimits, unit: float
) -> list[np.ndarray]:
    """The derivatives, limits and largest squared speeds of a curve whose timing keeps a point's limits as well.

    Along the point's path its speed and tangential acceleration are those of one more joint. Across it the acceleration
    is the squared speed times the curvature, and so a limit of the speed alone. TANGENTIAL and NORMAL share the limit.
    """
    length = float(curve.x[-1])
    h = POINT_STEP * length
    before, here, after = np.split(carried.position(curve(np.concatenate([s - h, s, s + h]))), 3)
    first, second = (after - before) / (2.0 * h), (after - 2.0 * here + before) / h**2
    norm = np.linalg.norm(first, axis=1)
    tangential = np.einsum("ij,ij->i", first, second) / np.maximum(norm, STILL)
    normal = np.sqrt(np.maximum(np.einsum("ij,ij->i", second, second) - tangential**2, 0.0))
    scale = unit**2 / length
    with np.errstate(divide="ignore"):
        most = NORMAL * carried.acceleration * scale / (normal * length)
    return [
        np.column_stack([rows[0], norm]),
        np.column_stack([rows[1], tangential * length]),
        np.append(rows[2], carried.speed * unit / length),
        np.append(rows[3], TANGENTIAL * carried.acceleration * scale),
        most,
    ]


def _grid(knots: np.ndarray, intervals: int) -> np.ndarray:
    """Grid points that contain the knots, each piece divided in proportion to its length."""
    counts = np.maximum(1, np.ceil(np.diff(knots) * intervals)).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(knots, knots[1:], counts, strict=False)]
    return np.concatenate([*pieces, knots[-1:]])


def _profile(s: np.ndarray, speed: np.ndarray) -> _Profile:
    speed = speed.copy()
    speed[0] = speed[-1] = 0.0
    periods = 2.0 * np.diff(s) / (speed[1:] + speed[:-1])
    time = np.concatenate([[0.0], np.cumsum(periods)])
    return _Profile(time, s, speed, np.diff(speed) / periods)


def _sample(curve: CubicSpline, profile: _Profile, steps: int, dt: float, start, end) -> TimedPath:
    """``steps + 1`` samples of the curve with the profile stretched evenly over ``steps * dt`` seconds."""
    time = np.arange(steps + 1) * dt
    stretch = steps * dt / profile.time[-1]
    t = time / stretch
    k = np.clip(np.searchsorted(profile.time, t, side="right") - 1, 0, len(profile.acceleration) - 1)
    tau = t - profile.time[k]
    s = profile.s[k] + tau * (profile.speed[k] + 0.5 * tau * profile.acceleration[k])
    speed = (profile.speed[k] + tau * profile.acceleration[k]) / stretch
    q, qd = curve(np.clip(s, 0.0, profile.s[-1])), curve(np.clip(s, 0.0, profile.s[-1]), 1) * speed[:, None]
    q[0], q[-1] = start, end
    qd[0] = qd[-1] = 0.0
    return TimedPath(time, q, qd)


def _limit_excess(q: np.ndarray, velocity_limits: np.ndarray, acceleration_limits: np.ndarray, dt: float) -> float:
    """How much longer the motion has to last for the differences of the samples to meet the limits; <= 1 if they do."""
    resting = np.concatenate([q[:1], q, q[-1:]])
    velocity = np.abs(np.diff(resting, axis=0)).max(axis=0) / dt
    acceleration = np.abs(np.diff(resting, 2, axis=0)).max(axis=0) / dt**2
    return max((velocity / velocity_limits).max(), np.sqrt((acceleration / acceleration_limits).max()))
