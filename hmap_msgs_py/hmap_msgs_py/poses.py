"""Conversions of poses (7,) = x, y, z, qx, qy, qz, qw (geometry_msgs). Metres; quaternions xyzw."""

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3

from hmap_msgs_py.checks import finite, poses, sound_pose, unit


def pose_to_message(pose: np.ndarray, name: str = "pose") -> Pose:
    """Convert a pose (7,).

    Raises:
        PoseError: the pose is malformed.
    """
    if isinstance(pose, np.ndarray) and pose.shape == (7,) and pose.dtype == np.float64:
        numbers = pose.tolist()
        if sound_pose(numbers):
            return _message(numbers)
    return _message(poses(name, [pose], 1)[0].tolist())


def pose_from_message(message: Pose, name: str = "pose") -> np.ndarray:
    """Convert to a pose (7,).

    Raises:
        PoseError: the pose is malformed.
    """
    numbers = _numbers(message)
    return np.array(numbers, np.float64) if sound_pose(numbers) else poses(name, [numbers], 1)[0]


def poses_to_messages(values: np.ndarray, name: str = "poses") -> list[Pose]:
    """Convert poses (N, 7).

    Raises:
        PoseError: a pose is malformed.
    """
    checked = poses(name, np.reshape(values, (-1, 7)) if np.size(values) == 0 else values)
    return [_message(numbers) for numbers in checked.tolist()]


def poses_from_messages(messages: Sequence[Pose], name: str = "poses") -> np.ndarray:
    """Convert to poses (N, 7).

    Raises:
        PoseError: a pose is malformed.
    """
    return np.array([pose_from_message(m, f"{name}[{i}]") for i, m in enumerate(messages)]).reshape(-1, 7)


def _message(numbers: Sequence[float]) -> Pose:
    message = Pose()  # its parts as arguments would be made twice
    p, q = message.position, message.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = numbers
    return message


def _numbers(message: Pose) -> list[float]:
    p, q = message.position, message.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def point_to_message(point: np.ndarray, name: str = "point") -> Point:
    """Convert a point (3,) in metres.

    Raises:
        ConversionError: it is not finite or has a wrong size.
    """
    x, y, z = finite(name, point, (3,)).tolist()
    return Point(x=x, y=y, z=z)


def point_from_message(message: Point | Vector3, name: str = "point") -> np.ndarray:
    """Convert to a point or vector (3,).

    Raises:
        ConversionError: it is not finite.
    """
    return finite(name, [message.x, message.y, message.z], (3,))


def direction_to_message(direction: np.ndarray, name: str = "direction") -> Vector3:
    """Convert a unit vector (3,).

    Raises:
        ConversionError: its norm is not 1.
    """
    x, y, z = unit(name, direction, (3,)).tolist()
    return Vector3(x=x, y=y, z=z)


def direction_from_message(message: Vector3, name: str = "direction") -> np.ndarray:
    """Convert to a unit vector (3,).

    Raises:
        ConversionError: its norm is not 1.
    """
    return unit(name, [message.x, message.y, message.z], (3,))
