"""The steps of a contact: which of the dense poses of an object's path the problem has."""

import numpy as np

from hmap_core.transforms import consistent

HOLD_STEP = (0.04, 0.15)  # m, rad between two steps in contact, about


def thinned(object_poses: np.ndarray, keyframes: np.ndarray, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    """Some of the dense poses (K, 7) and their configurations, about ``fineness`` HOLD_STEPs apart; ends are kept."""
    moved = np.linalg.norm(np.diff(object_poses[:, :3], axis=0), axis=1)
    chord = np.linalg.norm(np.diff(consistent(object_poses)[:, 3:], axis=0), axis=1)  # of half the turn
    turned = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    size = np.concatenate([[0.0], np.cumsum(np.maximum(moved / HOLD_STEP[0], turned / HOLD_STEP[1]))])
    count = max(2, int(np.ceil(size[-1] / fineness)) + 1)
    keep = np.unique(np.searchsorted(size, np.linspace(0.0, size[-1], count) - 1e-9).clip(0, len(size) - 1))
    if len(keep) == 1 < len(size):  # poses that are all alike
        keep = np.array([0, 0])
    keep[-1] = len(size) - 1
    return object_poses[keep], keyframes[: len(object_poses)][keep]
