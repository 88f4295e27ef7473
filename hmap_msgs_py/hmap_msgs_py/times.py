"""Conversions of times, durations and joint trajectories. Seconds; float64 keeps wall-clock stamps to 0.3 us."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hmap_msgs_py.checks import ConversionError, finite, same_length

NANOSECONDS = 1_000_000_000


def time_to_message(seconds: float) -> Time:
    """Convert seconds since the epoch of the clock.

    Raises:
        ConversionError: the time is not finite.
    """
    return Time(**_split(seconds))


def duration_to_message(seconds: float) -> Duration:
    """Convert seconds.

    Raises:
        ConversionError: the duration is not finite.
    """
    return Duration(**_split(seconds))


def seconds_from_message(message: Time | Duration) -> float:
    """Convert a stamp or a duration to seconds.

    Raises:
        ConversionError: it has a whole second or more of nanoseconds.
    """
    if message.nanosec >= NANOSECONDS:
        raise ConversionError(f"a time has {message.nanosec} nanoseconds; there must be fewer than {NANOSECONDS}")
    return message.sec + message.nanosec / NANOSECONDS


def joint_trajectory_to_message(
    joint_names: Sequence[str],
    time: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray | None = None,
    efforts: np.ndarray | None = None,
) -> JointTrajectory:
    """Convert a joint trajectory.

    A controller that gets no velocities interpolates linearly. It accepts velocities only if the last one is zero.

    Args:
        joint_names: names of the n joints.
        time: (N,) s from the start.
        positions: (N, n) rad or m.
        velocities: (N, n) rad/s or m/s, or None.
        efforts: (N, n) N m or N that the joints apply beside those that follow the motion, or None.

    Raises:
        ConversionError: a value is not finite, or sizes do not match.
    """
    names = list(joint_names)
    stamps = finite("time", time, (None,))
    rows = finite("positions", positions, (len(stamps), len(names)))
    rates = None if velocities is None else finite("velocities", velocities, rows.shape)
    forces = None if efforts is None else finite("efforts", efforts, rows.shape)
    points = [
        JointTrajectoryPoint(
            time_from_start=duration_to_message(stamps[i]),
            positions=rows[i].tolist(),
            velocities=[] if rates is None else rates[i].tolist(),
            effort=[] if forces is None else forces[i].tolist(),
        )
        for i in range(len(stamps))
    ]
    return JointTrajectory(joint_names=names, points=points)


def joint_trajectory_from_message(
    message: JointTrajectory, joint_names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Convert to times (N,), positions (N, n) and velocities (N, n) or None; columns are in the order of
    ``joint_names``.

    Raises:
        ConversionError: the joints differ, sizes do not match, times do not increase, or a value is not finite.
    """
    given = list(message.joint_names)
    if sorted(given) != sorted(joint_names):
        raise ConversionError(f"the trajectory is for {', '.join(given)}; it must be for {', '.join(joint_names)}")
    for i, point in enumerate(message.points):
        same_length(f"positions of point {i}", point.positions, len(given), "joints")
        if len(point.velocities):
            same_length(f"velocities of point {i}", point.velocities, len(given), "joints")
    time = np.array([seconds_from_message(point.time_from_start) for point in message.points])
    if np.any(np.diff(time) <= 0.0):
        raise ConversionError("the times of the trajectory must increase")
    columns = [given.index(name) for name in joint_names]
    shape = (len(time), len(given))
    positions = finite("positions", np.array([point.positions for point in message.points]).reshape(shape))
    if not len(time) or not all(len(point.velocities) for point in message.points):
        return time, positions[:, columns], None
    velocities = finite("velocities", np.array([point.velocities for point in message.points]), shape)
    return time, positions[:, columns], velocities[:, columns]


def joint_efforts_from_message(message: JointTrajectory, joint_names: Sequence[str]) -> np.ndarray | None:
    """Convert to efforts (N, n) in the order of ``joint_names``; None if a point has none.

    Args:
        message: one that :func:`joint_trajectory_from_message` accepts.
        joint_names: of the n joints.

    Raises:
        ConversionError: sizes do not match, or a value is not finite.
    """
    given = list(message.joint_names)
    if not len(message.points) or not all(len(point.effort) for point in message.points):
        return None
    for i, point in enumerate(message.points):
        same_length(f"effort of point {i}", point.effort, len(given), "joints")
    efforts = finite("efforts", np.array([point.effort for point in message.points]))
    return efforts[:, [given.index(name) for name in joint_names]]


def _split(seconds: float) -> dict[str, int]:
    nanoseconds = round(float(finite("time", seconds, ())) * NANOSECONDS)
    return {"sec": nanoseconds // NANOSECONDS, "nanosec": nanoseconds % NANOSECONDS}
