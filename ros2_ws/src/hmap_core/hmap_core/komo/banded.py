"""Cholesky of a symmetric banded matrix stored by rows of its upper half: A[i, k] holds element (i, i + k)."""

import math

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import PLAIN

PADDING = 3  # columns of zeros that the storage has beyond the band, since four rows are taken at a time
# sums may be regrouped, so that the processor's vector instructions are used
OPTIONS = dict(PLAIN, fastmath={"reassoc", "contract", "nsz"})
_U = np.uint64  # indices that are never negative: a signed one costs a test


@nb.njit(**OPTIONS)
def cholesky_solve(A, b, bandwidth):
    """Factors A (N, bandwidth + 1 + PADDING) in place and solves for b (N,) in place; False when not positive definite.

    Elements beyond the band or the matrix have to be zero.
    """
    N = b.shape[0]
    W = A.shape[1]
    F = A.reshape(-1)
    for i in range(N):
        row = _U(i * W)
        j = max(0, i - bandwidth)
        while j + 4 <= i:
            r = i - j
            o0, o1 = _U(j * W + r), _U((j + 1) * W + r - 1)
            o2, o3 = _U((j + 2) * W + r - 2), _U((j + 3) * W + r - 3)
            f0, f1, f2, f3 = F[o0], F[o1], F[o2], F[o3]
            if f0 != 0.0 or f1 != 0.0 or f2 != 0.0 or f3 != 0.0:
                for k in range(_U(bandwidth + 4 - r)):
                    F[row + k] -= f0 * F[o0 + k] + f1 * F[o1 + k] + f2 * F[o2 + k] + f3 * F[o3 + k]
                b[i] -= f0 * b[j] + f1 * b[j + 1] + f2 * b[j + 2] + f3 * b[j + 3]
            j += 4
        while j < i:
            r = i - j
            o0 = _U(j * W + r)
            f0 = F[o0]
            if f0 != 0.0:
                for k in range(_U(bandwidth + 1 - r)):
                    F[row + k] -= f0 * F[o0 + k]
                b[i] -= f0 * b[j]
            j += 1
        pivot = F[row]
        if not pivot > 0.0:
            return False
        scale = 1.0 / math.sqrt(pivot)
        for k in range(_U(bandwidth + 1)):
            F[row + k] *= scale
        b[i] *= scale
    for i in range(N - 1, -1, -1):
        row = _U(i * W)
        s = b[i]
        for k in range(_U(1), _U(min(bandwidth, N - 1 - i) + 1)):
            s -= F[row + k] * b[_U(i) + k]
        b[i] = s / F[row]
    return True
