"""Dense poses and waypoints of a path given by its corners."""

import numpy as np

from hmap_core.transforms import consistent, distance, quaternion_multiply
from hmap_core.waypoints.kernels import between

# largest distance of successive poses
POSITION_STEP = 0.01  # m
ROTATION_STEP = float(np.deg2rad(3.0))
# largest deviation from the checked motion between poses, for a body whose frame is not in its middle, m
CHORD_ERROR = 1e-4
# a waypoint is where the motion's direction has changed by more than this since the last one
CUT_ANGLE = float(np.deg2rad(10.0))
# smaller motions have no direction, m
_STILL = 1e-6


def chord_step(arm: float) -> float:
    """Largest rotation step for a body whose frame is not at the centre of rotation.

    Args:
        arm: radius in m of the arc that the frame's origin moves on.

    Returns:
        Rotation in rad, at most ROTATION_STEP, for which arc and chord differ by at most CHORD_ERROR.
    """
    return min(ROTATION_STEP, 2.0 * float(np.arccos(1.0 - CHORD_ERROR / max(arm, CHORD_ERROR))))


def resample(corners: np.ndarray, rotation_step: float = ROTATION_STEP) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate a path densely.

    Args:
        corners: (n, 7) poses; motions between them are straight.
        rotation_step: largest rotation between successive poses, rad.

    Returns:
        Dense poses (M, 7), and the index of each corner among them (n,).
    """
    poses, where = [corners[0]], [0]
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        d, angle = distance(a, b)
        count = max(int(np.ceil(max(d / POSITION_STEP, angle / rotation_step))), 1)
        part = between(a, b, np.linspace(0.0, 1.0, count + 1))[1:]
        part[-1] = b
        poses.extend(part)
        where.append(len(poses) - 1)
    return consistent(np.array(poses)), np.array(where)


def direction(a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    """Direction of the motion from a to b.

    Args:
        a: pose (7,).
        b: pose (7,).
        radius: m that one radian of rotation counts as.

    Returns:
        Unit vector (6,): displacement, then rotation vector times ``radius``, world frame; zero without motion.
    """
    q = quaternion_multiply(b[3:], a[3:] * [-1.0, -1.0, -1.0, 1.0])
    q = q if q[3] >= 0.0 else -q
    sine = np.linalg.norm(q[:3])
    turn = np.zeros(3) if sine < _STILL else 2.0 * np.arctan2(sine, q[3]) * q[:3] / sine
    twist = np.r_[b[:3] - a[:3], radius * turn]
    size = np.linalg.norm(twist)
    return twist / size if size > _STILL else np.zeros(6)


def cut(corners: np.ndarray, where: np.ndarray, radius: float) -> np.ndarray:
    """Determine the waypoints of a path.

    Args:
        corners: (n, 7) poses.
        where: (n,) index of each corner in the dense poses.
        radius: m that one radian of rotation counts as.

    Returns:
        Indices (I,) into the dense poses: the corners where the direction changes, and the end.
    """
    directions = [direction(a, b, radius) for a, b in zip(corners[:-1], corners[1:], strict=True)]
    cuts: list[int] = []
    last = directions[0]
    for k in range(1, len(directions)):
        if last @ directions[k] < np.cos(CUT_ANGLE):
            cuts.append(int(where[k]))
            last = directions[k]
    return np.array([*cuts, int(where[-1])])
