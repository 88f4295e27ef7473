"""Objectives unrolled over their steps, compiled: in Python it would take longer than to solve a configuration."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS
from hmap_core.komo.arrays import BAND, EQ, Terms
from hmap_core.komo.features.base import MAX_FRAMES

# columns of the table of objectives; the frames come after them
KERNEL, TYPE, DIM, ORDER, OFFSET, WIDTH, COUNT, FRAMES = range(8)


@nb.njit(**OPTIONS)
def _integers(count):
    return np.empty(count, np.int64)


@nb.njit(**OPTIONS)
def unroll(table, steps, between, places, samples, scale, target, band, params, tau):
    """The terms of some objectives, ordered by sample, and for each sample in the order of the objectives.

    Args:
        table: (K, FRAMES + MAX_FRAMES) of each objective; OFFSET is where its parameters begin, WIDTH how many more are
            those of its next step, COUNT how many steps it has.
        steps: (N,) of all objectives, one after the other.
        between: (B,) objectives that are asked at the samples ``places`` (B, 2: step and sample) too; equalities there
            as a band.
        scale, target, band: (K,), (K, MAX_DIM), (K, MAX_DIM) of each objective; params: of all.
    """
    K, N, B, S = table.shape[0], steps.shape[0], between.shape[0], samples.alpha.shape[0]
    by_sample = np.zeros(S + 1, np.int64)
    M, D = N + B, target.shape[1]
    at, own, step, offset = _integers(M), _integers(M), _integers(M), _integers(M)
    row = 0
    for k in range(K):
        for m in range(table[k, COUNT]):
            own[row], step[row], at[row] = k, steps[row], samples.first[steps[row] + 1] - 1
            offset[row] = table[k, OFFSET] + m * table[k, WIDTH]
            row += 1
    for m in range(B):
        own[row], step[row], at[row], offset[row] = between[m], places[m, 0], places[m, 1], table[between[m], OFFSET]
        row += 1
    for row in range(M):
        by_sample[at[row] + 1] += 1
    for s in range(S):
        by_sample[s + 1] += by_sample[s]
    free = by_sample.copy()
    kernel, kind, steps_of, dim = _integers(M), _integers(M), _integers(M), _integers(M)
    offsets, order, objective = _integers(M), _integers(M), _integers(M)
    frames, scales = np.empty((M, MAX_FRAMES), np.int64), np.empty(M)
    targets, bands = np.empty((M, D)), np.zeros((M, D))
    for row in range(M):
        k = own[row]
        m = free[at[row]]
        free[at[row]] = m + 1
        kernel[m], kind[m], steps_of[m], dim[m] = table[k, KERNEL], table[k, TYPE], step[row], table[k, DIM]
        scales[m], offsets[m], order[m], objective[m] = scale[k], offset[row], table[k, ORDER], k
        for i in range(MAX_FRAMES):
            frames[m, i] = table[k, FRAMES + i]
        for d in range(D):
            targets[m, d] = target[k, d]
        if row >= N and kind[m] == EQ:
            kind[m] = BAND
            for d in range(D):
                bands[m, d] = band[k, d]
    return Terms(
        kernel, kind, steps_of, dim, scales, frames, offsets, params, targets, order, bands, by_sample, objective, tau
    )
