"""Contact modes: which environment contacts are kept and which separate, and the velocities that a mode allows."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import nnls

from hmap_core.baselines.cmgmp.problem import EnvironmentContact

FEASIBLE = 1e-6  # residual above which a point is in no cone
ROUNDED = 3  # digits of contacts, in sizes of the object, by which modes are remembered
SLIDES = 1e-2  # share of the velocity from which on a kept contact counts as sliding
SINGULAR = 1e-7  # of singular values


def rows(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Rows (n, 6) whose product with a twist (v, w) is the velocity of points (n, 3) along directions (n, 3)."""
    return np.concatenate([directions, cross(points, directions)], axis=1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (n, 3) of vectors (n, 3); numpy's takes ten times as long for a few."""
    out = np.empty((max(len(a), len(b)), 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out


def tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (n, 3) each that span the planes of normals (n, 3)."""
    first = cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.sqrt((first**2).sum(axis=1))[:, None]
    return first, cross(normals, first)


@dataclass
class Enumeration:
    """Enumerates the feasible sets of kept contacts; contacts alike give the same modes.

    Attributes:
        size: of the object, which scales lengths.
    """

    size: float
    _known: dict[bytes, list[np.ndarray]] = field(default_factory=dict)

    def modes(self, contacts: list[EnvironmentContact], fixed: np.ndarray | None = None) -> list[np.ndarray]:
        """For each mode (n,) which contacts are kept.

        A mode is feasible if a twist keeps its contacts and separates all others: the faces of the cone of twists that
        do not penetrate (Huang, Cheng and Mason, Efficient contact mode enumeration in 3D, WAFR 2020).

        Args:
            contacts: of the object.
            fixed: (k, 6) further twists' rows that have to be zero.
        """
        if not contacts:
            return [np.zeros(0, bool)]
        normals = scaled(rows(*np.array([(c.point, c.normal) for c in contacts]).transpose(1, 0, 2)), self.size)
        extra = np.zeros((0, 6)) if fixed is None else scaled(fixed, self.size)
        key = np.round(np.concatenate([normals, extra]), ROUNDED).tobytes()
        if key not in self._known:
            found: list[np.ndarray] = []
            _branch(normals, extra, [], found)
            self._known[key] = found
        return self._known[key]


def scaled(constraints: np.ndarray, size: float) -> np.ndarray:
    """Rows (n, 6) for twists whose turns are measured in lengths."""
    return constraints / np.array([1.0, 1.0, 1.0, size, size, size])


def _branch(normals: np.ndarray, extra: np.ndarray, kept: list[bool], found: list[np.ndarray]) -> None:
    if len(kept) == len(normals):
        found.append(np.array(kept, bool))
        return
    for keep in (True, False):
        mask = np.array([*kept, keep], bool)
        own = normals[: len(mask)]
        if _separable(np.concatenate([extra, own[mask]]), own[~mask]):
            _branch(normals, extra, [*kept, keep], found)


def _separable(kept: np.ndarray, apart: np.ndarray) -> bool:
    """Whether a twist v has kept @ v = 0 and apart @ v > 0 (Gordan's theorem: no such v, or a positive combination)."""
    if not len(apart):
        return True
    matrix = np.concatenate([apart.T, kept.T, -kept.T], axis=1)
    weights = np.concatenate([np.ones(len(apart)), np.zeros(2 * len(kept))])
    _, residual = nnls(np.concatenate([matrix, weights[None]]), np.array([0.0] * 6 + [1.0]))
    return bool(residual > FEASIBLE)


def projected(twist: np.ndarray, constraints: np.ndarray, size: float) -> np.ndarray:
    """The twist (6,) nearest to a given one for which constraints (n, 6) are zero, turns measured in lengths."""
    if not len(constraints):
        return twist
    scale = np.array([1.0, 1.0, 1.0, size, size, size])
    matrix = constraints / scale
    _, values, V = np.linalg.svd(matrix, full_matrices=False)
    V = V[values > SINGULAR * max(values[0], 1.0)]
    u = twist * scale
    return (u - V.T @ (V @ u)) / scale
