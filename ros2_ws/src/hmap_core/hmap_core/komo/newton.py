"""The step of a solve: the minimum of the model with the inequalities that are active after it, compiled."""

import numba as nb

from hmap_core.collision.compile_options import PLAIN
from hmap_core.komo.banded import cholesky_solve

MODEL_ROUNDS = 6  # systems solved for one step, at most


@nb.njit(**PLAIN)
def _assemble(X, prefix, chain, mult, model, step, A, b):
    """The normal equations A, b of the model with the inequalities that are active after a step (T n,).

    Returns how many are active, as a checksum that tells different sets apart.
    """
    T, n = X.shape
    mu = mult.mu[0]
    H, G = model.H, model.G
    for k in range(T * n):
        for j in range(H.shape[1]):
            A[k, j] = H[k, j]
        b[k] = -G[k]
    active = 0
    for m in range(model.count[0]):
        t, alpha, row, value, weight = model.step[m], model.alpha[m], model.row[m], model.value[m], model.weight[m]
        beta = 1.0 - alpha
        before = t > 0 and beta > 0.0
        predicted = value
        k = n * t
        for i in range(n):
            predicted += alpha * row[i] * step[k + i]
            if before:
                predicted += beta * row[i] * step[k - n + i]
        if predicted <= 0.0:
            continue
        active += (m + 1) * (m + 7)
        for i in range(n):
            g = weight * row[i]
            if g == 0.0:
                continue
            b[k + i] -= alpha * g * value
            for j in range(i, n):
                A[k + i, j - i] += alpha * alpha * g * row[j]
            if before:
                b[k - n + i] -= beta * g * value
                for j in range(i, n):
                    A[k - n + i, j - i] += beta * beta * g * row[j]
                for j in range(n):
                    A[k - n + i, n + j - i] += alpha * beta * g * row[j]
    for t in range(T):
        for i in range(n):
            k = n * t + i
            for side in range(2):
                sign = -1.0 if side == 0 else 1.0
                c = chain.lower[i] - X[t, i] if side == 0 else X[t, i] - chain.upper[i]
                value = c + mult.limits[t, i, side] / mu
                if value + sign * step[k] > 0.0:
                    active += (k + 1) * (k + 11) * (side + 3)
                    b[k] -= mu * value * sign
                    A[k, 0] += mu
    return active


@nb.njit(**PLAIN)
def model_step(X, prefix, chain, mult, model, damping, bandwidth, A, b, gradient, step):
    """The step (T n,) that minimises the model, and the gradient at X.

    The model is quadratic but for the inequalities, which are active or not. Each step predicts its active set, again
    until that does not change (a semi-smooth Newton method [1]), so it does not run into an inactive inequality.

    [1] Hintermueller, Ito, Kunisch, The primal-dual active set strategy as a semismooth Newton method, 2002.

    Returns False where the normal equations are not positive definite.
    """
    N = step.shape[0]
    step[:] = 0.0
    before = 0
    for attempt in range(MODEL_ROUNDS):
        active = _assemble(X, prefix, chain, mult, model, step, A, b)
        if attempt == 0:
            for k in range(N):
                gradient[k] = -b[k]
        elif active == before:
            return True
        before = active
        for k in range(N):
            A[k, 0] += damping
        if not cholesky_solve(A, b, bandwidth):
            return False
        for k in range(N):
            step[k] = b[k]
    return True
