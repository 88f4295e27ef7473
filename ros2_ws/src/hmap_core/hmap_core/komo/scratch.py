"""Room for the numbers of a solve: multipliers, scratch and the model; see :mod:`hmap_core.komo.arrays`."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.collision.simplex import WORK
from hmap_core.kinematics.tree import forward
from hmap_core.komo.arrays import Model, Multipliers, Scratch
from hmap_core.komo.banded import PADDING
from hmap_core.komo.features.base import MAX_DIM

MAX_ORDER = 2  # of the differences along the path that an objective may ask for


@nb.njit(**OPTIONS)
def new_multipliers(T, n, terms, cols, samples, mu):
    """Multipliers to begin with: none is active yet."""
    return Multipliers(
        np.zeros((terms.kernel.shape[0], MAX_DIM)), np.zeros((samples.alpha.shape[0], cols.a.shape[0])),
        np.zeros((T, n, 2)), np.full(1, mu),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def new_scratch(T, n, chain, terms, cols, samples, prefix):
    """Scratch for a problem of T steps."""
    P, S = cols.a.shape[0], samples.alpha.shape[0]
    order = 0
    for m in range(terms.order.shape[0]):
        order = max(order, terms.order[m])
    kept = T + MAX_ORDER if order > 0 else 1
    R, p = np.zeros((kept, n + 1, 3, 3)), np.zeros((kept, n + 1, 3))
    if order > 0:
        for k in range(MAX_ORDER):
            forward(prefix[k], chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[k], p[k])
    shapes = cols.frame.shape[0]
    return Scratch(
        R, p, np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n, n)), np.zeros(n),
        np.zeros((3, 3)), np.zeros(WORK), np.zeros(MAX_DIM), np.zeros(MAX_DIM), np.zeros((MAX_DIM, n)),
        np.zeros((MAX_ORDER + 1, MAX_DIM, n)), np.zeros(n), np.zeros((S, n)), np.zeros(S), np.zeros(S),
        np.zeros(S, np.bool_), np.empty((S, shapes, 3)), np.empty((S, n + 1, 3, 3)), np.empty((S, P)),
        np.empty((S, P, 9), np.int16), np.zeros(shapes),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def new_model(T, n, terms, cols, samples):
    """Room for the model of a problem of T steps."""
    M = samples.alpha.shape[0] * cols.a.shape[0] + 1
    for m in range(terms.dim.shape[0]):
        M += terms.dim[m]
    return Model(
        np.zeros((T * n, 3 * n + PADDING)), np.zeros(T * n), np.empty((M, n)), np.empty(M, np.int64), np.empty(M),
        np.empty(M), np.empty(M), np.empty(M, np.int64), np.empty(M, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip
