"""Which samples of a motion to keep, so that not much happens between two of them."""

import numpy as np


def by_length(lengths: np.ndarray, step: float = 1.0) -> np.ndarray:
    """Keep samples about ``step`` apart along the path, the first and the last among them.

    Args:
        lengths: (N,) length of the path from the sample before to each sample; the first is 0.
        step: length between two kept samples.

    Returns:
        Indices of the kept samples, increasing.
    """
    way = np.cumsum(lengths) / step
    kept = np.flatnonzero(np.diff(np.floor(way), prepend=-1.0) > 0.0)
    return np.unique(np.concatenate([[0], kept, [len(lengths) - 1]]))


def by_change(rows: np.ndarray) -> np.ndarray:
    """Keep the first of some rows (M, k), each that differs by 1 or more from the last one kept, and the last.

    Returns:
        Indices of the kept rows, increasing.
    """
    keep = [0]
    while keep[-1] < len(rows) - 1:
        ahead = rows[keep[-1] + 1 :]
        far = np.abs(ahead - rows[keep[-1]]).max(axis=1) >= 1.0
        keep.append(keep[-1] + 1 + int(far.argmax() if far.any() else len(ahead) - 1))
    return np.array(keep)


def pose_steps(poses: np.ndarray, position_step: float, rotation_step: float) -> tuple[np.ndarray, np.ndarray]:
    """How far a body moves between neighbouring poses (N, 7), in steps.

    Args:
        poses: (N, 7) poses of the body.
        position_step: m of translation that count as one step.
        rotation_step: rad of rotation that count as one step.

    Returns:
        Steps of translation and of rotation, (N - 1,) each.
    """
    moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / position_step
    dots = np.abs(np.einsum("ij,ij->i", poses[1:, 3:], poses[:-1, 3:])).clip(0.0, 1.0)
    return moved, 2.0 * np.arccos(dots) / rotation_step
