"""Measured poses of a body, filtered over time: their mean while it stands, the newest while it moves."""

from collections.abc import Sequence

import numpy as np

from hmap_core import transforms

WINDOW = 1.0  # s of measurements that are averaged
FEWEST = 5  # measurements that are averaged
POSE_NOISE = 0.001  # m, standard deviation of a measured position
MARKER_SPAN = 0.1  # m between markers, by which noise of their positions becomes noise of the rotation
OUTLIER = 5.0  # standard deviations that a measurement of a standing body may be off the mean
DRIFT = 4.0  # standard deviations that the means of two halves of the measurements may differ


def filtered(poses: Sequence[np.ndarray], noise: float) -> np.ndarray:
    """The pose (7,) of a body from its newest measurements.

    Args:
        poses: (7,) each, in the order of their stamps, within WINDOW.
        noise: m, standard deviation of a measured position; 0: the newest counts.
    """
    newest = poses[-1]
    if noise <= 0.0 or len(poses) < FEWEST:
        return newest
    T = np.array(poses)
    T[:, 3:] *= np.sign(T[:, 3:] @ newest[3:])[:, None]  # q and -q are the same rotation
    mean = T.mean(axis=0)
    mean = transforms.pose(mean[:3], mean[3:] / np.linalg.norm(mean[3:]))
    scale = np.concatenate(
        [np.full(3, noise), np.full(4, 0.5 * noise / MARKER_SPAN)]
    )  # of a quaternion: half the angle
    half = len(T) // 2
    apart = np.abs(T[:half].mean(axis=0) - T[-half:].mean(axis=0)) / scale
    stands = np.abs(T - mean).max(axis=0) <= OUTLIER * scale
    return mean if stands.all() and apart.max() <= DRIFT * np.sqrt(2.0 / half) else newest
