"""Penetration depth of two overlapping shapes by the expanding polytope algorithm.

van den Bergen, Proximity queries and penetration depth computation on 3D game objects, 2001.
"""

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, OPTIONS, PLAIN
from hmap_core.collision.simplex import (
    WA,
    WB,
    W,
    cross,
    is_flat,
    set_point,
    six_volumes,
    support,
    triangle_weights,
    vertex,
)

EPA_GAP = 1e-7  # m: accuracy of the penetration depth
EPA_VERTICES = 64
EPA_FACES = 192
FAR = 1e9


@nb.njit(**INLINE)
def _plane(P, i, j, k):
    """Unit normal of the triangle of the rows i, j, k of P and its distance from the origin; -1 when degenerate."""
    u0, u1, u2 = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
    w0, w1, w2 = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
    n0, n1, n2 = cross(u0, u1, u2, w0, w1, w2)
    length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if length < 1e-16:
        return 0.0, 0.0, 0.0, -1.0
    n0, n1, n2 = n0 / length, n1 / length, n2 / length
    return n0, n1, n2, n0 * P[i, 0] + n1 * P[i, 1] + n2 * P[i, 2]


@nb.njit(**OPTIONS)
def grow_to_tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, work, n):
    """Grows a simplex of n < 4 points that contains the origin to a tetrahedron with volume; returns its size."""
    directions = np.array(
        [
            [1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0], [0, 0, -1.0],
            [0.6, 0.6, 0.53], [-0.6, 0.53, 0.6], [0.53, -0.6, -0.6], [-0.53, -0.6, 0.6],
        ]
    )  # fmt: skip
    P = work[W:WA].reshape(4, 3)
    for d in range(directions.shape[0] + 2):
        if n == 4:
            return 4
        if n == 3:
            # the two normals of the triangle first, they are the best bet
            d0, d1, d2, _ = _plane(P, 0, 1, 2)
            if d % 2 == 1:
                d0, d1, d2 = -d0, -d1, -d2
        else:
            k = d % directions.shape[0]
            d0, d1, d2 = directions[k, 0], directions[k, 1], directions[k, 2]
        a0, a1, a2 = vertex(VA, RA, pA, support(VA, EA, 0, RA, d0, d1, d2))
        b0, b1, b2 = vertex(VB, RB, pB, support(VB, EB, 0, RB, -d0, -d1, -d2))
        set_point(work, n, a0, a1, a2, b0, b1, b2)
        if n == 0:
            n = 1
        elif n == 1:
            if (P[1, 0] - P[0, 0]) ** 2 + (P[1, 1] - P[0, 1]) ** 2 + (P[1, 2] - P[0, 2]) ** 2 > 1e-16:
                n = 2
        elif n == 2:
            if _plane(P, 0, 1, 2)[3] != -1.0:
                n = 3
        elif not is_flat(work, W, W + 3, W + 6, six_volumes(work, W, W + 3, W + 6, P[3, 0], P[3, 1], P[3, 2])):
            n = 4
    return n


@nb.njit(**PLAIN)
def _add_face(P, F, N, m, i, j, k):
    """Writes the triangle i, j, k as face m: its vertices to F, its outward normal and distance to N."""
    n0, n1, n2, d = _plane(P, i, j, k)
    F[m, 0], F[m, 1], F[m, 2] = i, j, k
    N[m, 0], N[m, 1], N[m, 2], N[m, 3] = n0, n1, n2, d


@nb.njit(**OPTIONS)
def penetration_depth(VA, EA, RA, pA, VB, EB, RB, pB, guess, work, witness):
    """Penetration depth of two overlapping cores from a tetrahedron round the origin.

    Writes the unit normal from A into B and the deepest points of A and B to witness (3, 3).
    """
    P = np.empty((EPA_VERTICES, 9))  # points of A - B, of A, of B
    N = np.empty((EPA_FACES, 4))
    F = np.empty((EPA_FACES, 3), np.int64)
    E = np.empty((EPA_FACES, 2), np.int64)  # rim of the faces that are removed
    for i in range(4):
        for x in range(3):
            P[i, x], P[i, 3 + x], P[i, 6 + x] = work[W + 3 * i + x], work[WA + 3 * i + x], work[WB + 3 * i + x]
    for f in range(4):
        i, j, k = (1, 2, 3) if f == 0 else ((0, 3, 2) if f == 1 else ((0, 1, 3) if f == 2 else (0, 2, 1)))
        if six_volumes(work, W + 3 * i, W + 3 * j, W + 3 * k, P[f, 0], P[f, 1], P[f, 2]) > 0.0:
            i, j = j, i
        _add_face(P, F, N, f, i, j, k)
    n = m = 4
    ia, ib = guess[1], guess[5]
    best = 0
    for _ in range(EPA_VERTICES):
        best = 0
        for f in range(1, m):
            if N[f, 3] < N[best, 3]:
                best = f
        n0, n1, n2 = N[best, 0], N[best, 1], N[best, 2]
        ia = support(VA, EA, ia, RA, n0, n1, n2)
        ib = support(VB, EB, ib, RB, -n0, -n1, -n2)
        a0, a1, a2 = vertex(VA, RA, pA, ia)
        b0, b1, b2 = vertex(VB, RB, pB, ib)
        w0, w1, w2 = a0 - b0, a1 - b1, a2 - b2
        if n0 * w0 + n1 * w1 + n2 * w2 - N[best, 3] <= EPA_GAP or n == EPA_VERTICES:
            break
        P[n, 0], P[n, 1], P[n, 2] = w0, w1, w2
        P[n, 3], P[n, 4], P[n, 5] = a0, a1, a2
        P[n, 6], P[n, 7], P[n, 8] = b0, b1, b2
        # remove the faces that the new point sees, and join their rim to it
        edges = 0
        kept = 0
        for f in range(m):
            u = F[f, 0]
            visible = N[f, 0] * (w0 - P[u, 0]) + N[f, 1] * (w1 - P[u, 1]) + N[f, 2] * (w2 - P[u, 2])
            if visible > 1e-12:
                for e in range(3):
                    u, w = F[f, e], F[f, e + 1 if e < 2 else 0]
                    twin = -1
                    for g in range(edges):
                        if E[g, 0] == w and E[g, 1] == u:
                            twin = g
                            break
                    if twin >= 0:
                        edges -= 1
                        E[twin, 0], E[twin, 1] = E[edges, 0], E[edges, 1]
                    elif edges < EPA_FACES:
                        E[edges, 0], E[edges, 1] = u, w
                        edges += 1
            else:
                if kept != f:
                    for x in range(3):
                        F[kept, x] = F[f, x]
                    for x in range(4):
                        N[kept, x] = N[f, x]
                kept += 1
        if edges == 0 or kept + edges > EPA_FACES:
            break
        m = kept
        for g in range(edges):
            _add_face(P, F, N, m, E[g, 0], E[g, 1], n)
            if N[m, 3] < -0.5:
                N[m, 3] = FAR
            m += 1
        n += 1
    # of the triangles of the nearest plane, the one that holds the foot of the origin: only its points are opposite
    depth = N[best, 3]
    off = FAR
    b0, b1, b2 = 1.0, 0.0, 0.0
    for f in range(m):
        d = N[f, 3]
        if d > depth + EPA_GAP:
            continue
        i, j, k = F[f, 0], F[f, 1], F[f, 2]
        s0, s1, s2 = d * N[f, 0], d * N[f, 1], d * N[f, 2]
        x, y, z = triangle_weights(
            P[i, 0] - s0, P[i, 1] - s1, P[i, 2] - s2, P[j, 0] - s0, P[j, 1] - s1, P[j, 2] - s2,
            P[k, 0] - s0, P[k, 1] - s1, P[k, 2] - s2,
        )  # fmt: skip
        square = (
            (x * P[i, 0] + y * P[j, 0] + z * P[k, 0] - s0) ** 2
            + (x * P[i, 1] + y * P[j, 1] + z * P[k, 1] - s1) ** 2
            + (x * P[i, 2] + y * P[j, 2] + z * P[k, 2] - s2) ** 2
        )
        if square < off:
            off = square
            best = f
            b0, b1, b2 = x, y, z
    i, j, k = F[best, 0], F[best, 1], F[best, 2]
    for x in range(3):
        witness[0, x] = N[best, x]
        witness[1, x] = b0 * P[i, 3 + x] + b1 * P[j, 3 + x] + b2 * P[k, 3 + x]
        witness[2, x] = b0 * P[i, 6 + x] + b1 * P[j, 6 + x] + b2 * P[k, 6 + x]
    return max(0.0, N[best, 3])
