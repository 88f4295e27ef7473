"""Compiled distances of all pairs of a CollisionModel, given the frames."""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE
from hmap_core.collision.gjk import distance_from

BEYOND = 1e3  # m, reported distance of a pair that is far apart


@nb.njit(**INLINE)
def place_centers(cols, R, p, centers):
    """World positions (S, 3) of the centres of the bounding spheres."""
    frame, center = cols.frame, cols.center
    for s in range(frame.shape[0]):
        f = frame[s]
        c0, c1, c2 = center[s, 0], center[s, 1], center[s, 2]
        for x in range(3):
            centers[s, x] = p[f, x] + R[f, x, 0] * c0 + R[f, x, 1] * c1 + R[f, x, 2] * c2


@nb.njit(**INLINE)
def move_on(cols, R, p, centers, turned, moved, slack):
    """Moves the shapes to new frames and reduces the slack of each pair by the motion of its shapes.

    A point of a shape moves by at most the motion of the centre of its bounding sphere, plus the radius of the sphere
    times the norm of the difference of the rotations.

    Args:
        cols: the collision model.
        R, p: (F, 3, 3), (F, 3) new frames.
        centers: (S, 3) in and out; centres of the bounding spheres.
        turned: (F, 3, 3) in and out; the rotations that ``centers`` belong to.
        moved: (S,) scratch.
        slack: (P,) in and out, m.
    """
    frame, center, bound = cols.frame, cols.center, cols.bound
    last = -1
    turn = 0.0
    for s in range(frame.shape[0]):
        f = frame[s]
        if f == 0:
            moved[s] = 0.0
            continue
        if f != last:
            last = f
            turn = 0.0
            for x in range(3):
                for y in range(3):
                    difference = R[f, x, y] - turned[f, x, y]
                    turn += difference * difference
            turn = np.sqrt(0.5 * turn)
        c0, c1, c2 = center[s, 0], center[s, 1], center[s, 2]
        square = 0.0
        for x in range(3):
            value = p[f, x] + R[f, x, 0] * c0 + R[f, x, 1] * c1 + R[f, x, 2] * c2
            square += (value - centers[s, x]) ** 2
            centers[s, x] = value
        moved[s] = np.sqrt(square) + turn * bound[s]
    for f in range(1, R.shape[0]):
        for x in range(3):
            for y in range(3):
                turned[f, x, y] = R[f, x, y]
    a, b = cols.a, cols.b
    for k in range(a.shape[0]):
        slack[k] -= moved[a[k]] + moved[b[k]]


@nb.njit(**INLINE)
def _box_distance(low, high, R, p, c):
    """Distance of a world point c (3,) from the box [low, high] of the frame (R, p)."""
    d0, d1, d2 = c[0] - p[0], c[1] - p[1], c[2] - p[2]
    square = 0.0
    for x in range(3):
        v = R[0, x] * d0 + R[1, x] * d1 + R[2, x] * d2
        e = max(low[x] - v, v - high[x])
        if e > 0.0:
            square += e * e
    return np.sqrt(square)


@nb.njit(**INLINE)
def pair_distance(cols, k, R, p, centers, cutoff, guess, witness, work):
    """Signed distance (m) of pair k, or a lower bound above ``cutoff``.

    ``guess`` (9,) is the cached GJK guess: the closest features of the last query, with which this query starts.
    """
    a, b = cols.a[k], cols.b[k]
    ca, cb = centers[a], centers[b]
    d0, d1, d2 = ca[0] - cb[0], ca[1] - cb[1], ca[2] - cb[2]
    gap = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) - cols.bound[a] - cols.bound[b]
    if gap > cutoff:
        return gap
    fa, fb = cols.frame[a], cols.frame[b]
    if cols.bound[a] < cols.bound[b]:
        gap = _box_distance(cols.low[b], cols.high[b], R[fb], p[fb], ca) - cols.bound[a]
    else:
        gap = _box_distance(cols.low[a], cols.high[a], R[fa], p[fa], cb) - cols.bound[b]
    if gap > cutoff:
        return gap
    work[0], work[1], work[2] = d0, d1, d2
    return distance_from(
        cols.vertices[cols.start[a] : cols.start[a + 1]], cols.edges[cols.edge[a] : cols.edge[a + 1]],
        R[fa], p[fa], cols.radius[a],
        cols.vertices[cols.start[b] : cols.start[b + 1]], cols.edges[cols.edge[b] : cols.edge[b + 1]],
        R[fb], p[fb], cols.radius[b],
        cutoff, guess, witness, work,
    )  # fmt: skip
