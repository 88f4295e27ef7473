"""Cholesky of a symmetric banded matrix stored by rows: A[i, k] holds element (i, i - k)."""

import math

import numba as nb

from hmap_core.collision.gjk import OPTIONS


@nb.njit(**OPTIONS)
def cholesky_solve(A, b, bandwidth):
    """Factors A (N, bandwidth + 1) in place and solves for b (N,) in place; False when not positive definite."""
    N = b.shape[0]
    for i in range(N):
        low = max(0, i - bandwidth)
        for j in range(low, i + 1):
            s = A[i, i - j]
            start = max(low, j - bandwidth)
            for k in range(start, j):
                s -= A[i, i - k] * A[j, j - k]
            if j == i:
                if s <= 0.0:
                    return False
                A[i, 0] = math.sqrt(s)
            else:
                A[i, i - j] = s / A[j, 0]
    for i in range(N):
        s = b[i]
        for k in range(1, min(i, bandwidth) + 1):
            s -= A[i, k] * b[i - k]
        b[i] = s / A[i, 0]
    for i in range(N - 1, -1, -1):
        s = b[i] / A[i, 0]
        b[i] = s
        for k in range(1, min(i, bandwidth) + 1):
            b[i - k] -= A[i, k] * s
    return True
