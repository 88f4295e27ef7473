"""Signed distance of two convex shapes: GJK outside, EPA inside.

A shape is the convex hull of vertices swept by a sphere: a box is 8 vertices and radius 0, a sphere one vertex and its
radius, a capsule two. Outside, the distance of the cores is found by GJK [1]; in overlap the penetration depth is found
by the expanding polytope algorithm, so the value keeps growing and its gradient keeps its meaning however deep the
overlap is. Between configurations that differ little the last simplex is nearly right, and the farthest vertex is found
by climbing along the hull's edges from the last one.

[1] Gilbert, Johnson, Keerthi, A fast procedure for computing the distance between complex objects, 1988.
"""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, OPTIONS, PLAIN
from hmap_core.collision.epa import FAR, grow_to_tetrahedron, penetration_depth
from hmap_core.collision.simplex import BARY, WA, WB, WORK, V, reduce, set_point, support, vertex

MAX_ITERATIONS = 48
RELATIVE_GAP = 1e-7  # of the squared distance, where GJK stops
TOUCHING = 1e-9  # m: cores nearer than this count as overlapping


@nb.njit(**INLINE)
def _gjk(VA, EA, RA, pA, VB, EB, RB, pB, cutoff, guess, work):
    """Closest points of two cores. Returns (simplex size, distance or a lower bound beyond cutoff).

    Size 0: farther apart than ``cutoff`` (the distance returned is a lower bound, the scratch has the separating
    direction). Size 4, or distance 0: overlapping. The simplex of the last call, in ``guess``, is where it starts.
    """
    n = guess[0]
    fresh = n == 0
    if fresh:
        guess[1] = 0
        guess[5] = 0
        vv = work[V] * work[V] + work[V + 1] * work[V + 1] + work[V + 2] * work[V + 2]
        if vv < 1e-18:
            work[V], work[V + 1], work[V + 2] = 1.0, 0.0, 0.0
            vv = 1.0
    else:
        for i in range(n):
            a0, a1, a2 = vertex(VA, RA, pA, guess[1 + i])
            b0, b1, b2 = vertex(VB, RB, pB, guess[5 + i])
            set_point(work, i, a0, a1, a2, b0, b1, b2)
        n, vv = reduce(work, guess, n)
        if n == 4:
            guess[0] = 4
            return 4, 0.0
        if vv <= TOUCHING * TOUCHING:
            return n, 0.0
    for _ in range(MAX_ITERATIONS):
        v0, v1, v2 = work[V], work[V + 1], work[V + 2]
        last = max(n - 1, 0)
        ia = support(VA, EA, guess[1 + last], RA, -v0, -v1, -v2)
        ib = support(VB, EB, guess[5 + last], RB, v0, v1, v2)
        a0, a1, a2 = vertex(VA, RA, pA, ia)
        b0, b1, b2 = vertex(VB, RB, pB, ib)
        vw = v0 * (a0 - b0) + v1 * (a1 - b1) + v2 * (a2 - b2)
        if vw > 0.0 and vw * vw > cutoff * cutoff * vv:
            if n == 0:
                guess[0] = 1
                guess[1] = ia
                guess[5] = ib
            return 0, vw / np.sqrt(vv)
        if not fresh and vv - vw <= RELATIVE_GAP * vv:
            break
        seen = False
        for i in range(n):
            if guess[1 + i] == ia and guess[5 + i] == ib:
                seen = True
        if seen:
            break
        set_point(work, n, a0, a1, a2, b0, b1, b2)
        guess[1 + n] = ia
        guess[5 + n] = ib
        n, new = reduce(work, guess, n + 1)
        if n == 4:
            guess[0] = 4
            return 4, 0.0
        if new <= TOUCHING * TOUCHING:
            return n, 0.0
        if not fresh and new >= vv:
            vv = new
            break
        vv = new
        fresh = False
    return n, np.sqrt(vv)


@nb.njit(**PLAIN)
def distance_from(VA, EA, RA, pA, rA, VB, EB, RB, pB, rB, cutoff, guess, witness, work):
    """:func:`distance_within` that starts from what it found last time.

    Args:
        EA, EB: edges of the hulls (see :func:`hmap_core.collision.edges.hull_edges`), or empty.
        guess: (9,) size of the last simplex, its vertices of A (4,), of B (4,); read and written. Size 0: none.
    """
    radius = rA + rB
    n, d = _gjk(VA, EA, RA, pA, VB, EB, RB, pB, cutoff + radius, guess, work)
    if n == 0:
        return d - radius
    if n < 4 and d > 0.0:
        for x in range(3):
            witness[0, x] = work[V + x] / d
            pa = 0.0
            pb = 0.0
            for i in range(n):
                pa += work[BARY + i] * work[WA + 3 * i + x]
                pb += work[BARY + i] * work[WB + 3 * i + x]
            witness[1, x] = pa - rA * witness[0, x]
            witness[2, x] = pb + rB * witness[0, x]
        return d - radius
    if n < 4:
        n = grow_to_tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, work, n)
        guess[0] = 0  # the vertices that were added have no place in it
        guess[1] = 0
        guess[5] = 0
    if n < 4:
        # both cores lie in one plane or line: they touch, with no depth to speak of
        for x in range(3):
            witness[0, x] = 1.0 if x == 2 else 0.0
            witness[1, x] = work[WA + x]
            witness[2, x] = work[WB + x]
        return -radius
    depth = penetration_depth(VA, EA, RA, pA, VB, EB, RB, pB, guess, work, witness)
    for x in range(3):
        witness[0, x] = -witness[0, x]
        work[V + x] = witness[0, x]
        witness[1, x] -= rA * witness[0, x]
        witness[2, x] += rB * witness[0, x]
    return -depth - radius


@nb.njit(**OPTIONS)
def distance_within(VA, RA, pA, rA, VB, RB, pB, rB, cutoff, witness, work):
    """Signed distance of two shapes, or any value above ``cutoff`` when they are farther apart than that.

    Args:
        VA, VB: vertices (n, 3) in the frame of their shape; RA, RB (3, 3), pA, pB (3,): where the frames are, world.
        rA, rB: radius of the swept sphere, metres.
        cutoff: distance in metres beyond which the exact value does not matter.
        witness: out (3, 3): unit normal from B towards A, closest point on A, closest point on B; world.
        work: scratch of WORK numbers; ``work[:3]`` is the direction to start with (the last separating one makes it
            fast).

    Returns:
        Distance in metres, negative by the penetration depth.
    """
    none = np.empty(0, np.int32)
    guess = np.zeros(9, np.int16)
    return distance_from(VA, none, RA, pA, rA, VB, none, RB, pB, rB, cutoff, guess, witness, work)


@nb.njit(**OPTIONS)
def signed_distance(VA, RA, pA, rA, VB, RB, pB, rB, witness):
    """:func:`distance_within` without a cutoff."""
    work = np.zeros(WORK)
    work[:3] = pA - pB
    return distance_within(VA, RA, pA, rA, VB, RB, pB, rB, FAR, witness, work)
