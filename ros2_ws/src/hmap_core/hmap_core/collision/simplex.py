"""The simplex of GJK: points of A - B in a scratch, and the one of them that is closest to the origin.

The closest points of segment, triangle and tetrahedron are found after Ericson, Real-Time Collision Detection, 2005,
ch. 5.
"""

import numba as nb

from hmap_core.collision.compile_options import INLINE, PLAIN

FLAT = 1e-12  # m: four points of which none is farther than this from the plane of the others have no inside
# offsets into the scratch: direction, simplex of A - B, its points on A and on B (4 each), their weights
V, W, WA, WB, BARY = 0, 3, 15, 27, 39
WORK = 60  # numbers of the scratch


@nb.njit(**INLINE)
def vertex(P, R, p, index):
    """Vertex ``index`` of (P, R, p) in the world frame."""
    v0, v1, v2 = P[index, 0], P[index, 1], P[index, 2]
    return (
        R[0, 0] * v0 + R[0, 1] * v1 + R[0, 2] * v2 + p[0],
        R[1, 0] * v0 + R[1, 1] * v1 + R[1, 2] * v2 + p[1],
        R[2, 0] * v0 + R[2, 1] * v1 + R[2, 2] * v2 + p[2],
    )


@nb.njit(**INLINE)
def support(P, edges, start, R, d0, d1, d2):
    """Index of the vertex of P, turned by R, farthest along the world direction d.

    With ``edges`` it climbs from vertex ``start`` along the hull's edges, else it looks at every vertex.
    """
    l0 = R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2
    l1 = R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2
    l2 = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
    index = 0
    if edges.shape[0] == 0:
        best = -1e300
        for i in range(P.shape[0]):
            value = P[i, 0] * l0 + P[i, 1] * l1 + P[i, 2] * l2
            if value > best:
                best = value
                index = i
        return index
    index = start
    best = P[index, 0] * l0 + P[index, 1] * l1 + P[index, 2] * l2
    here = -1
    while here != index:
        here = index
        for e in range(edges[here], edges[here + 1]):
            i = edges[e]
            value = P[i, 0] * l0 + P[i, 1] * l1 + P[i, 2] * l2
            if value > best:
                best = value
                index = i
    return index


@nb.njit(**INLINE)
def segment_weights(a0, a1, a2, b0, b1, b2):
    """Weights of the point of segment ab closest to the origin."""
    u0, u1, u2 = b0 - a0, b1 - a1, b2 - a2
    denominator = u0 * u0 + u1 * u1 + u2 * u2
    t = 0.0
    if denominator > 0.0:
        t = -(a0 * u0 + a1 * u1 + a2 * u2) / denominator
    t = min(1.0, max(0.0, t))
    return 1.0 - t, t


@nb.njit(**PLAIN)
def triangle_weights(a0, a1, a2, b0, b1, b2, c0, c1, c2):
    """Weights of the point of triangle abc closest to the origin [Ericson, 5.1.5]."""
    ab0, ab1, ab2 = b0 - a0, b1 - a1, b2 - a2
    ac0, ac1, ac2 = c0 - a0, c1 - a1, c2 - a2
    d1 = -(ab0 * a0 + ab1 * a1 + ab2 * a2)
    d2 = -(ac0 * a0 + ac1 * a1 + ac2 * a2)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    d3 = -(ab0 * b0 + ab1 * b1 + ab2 * b2)
    d4 = -(ac0 * b0 + ac1 * b1 + ac2 * b2)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3) if d1 != d3 else 0.0
        return 1.0 - v, v, 0.0
    d5 = -(ab0 * c0 + ab1 * c1 + ab2 * c2)
    d6 = -(ac0 * c0 + ac1 * c1 + ac2 * c2)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6) if d2 != d6 else 0.0
        return 1.0 - w, 0.0, w
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        total = (d4 - d3) + (d5 - d6)
        w = (d4 - d3) / total if total > 0.0 else 0.0
        return 0.0, 1.0 - w, w
    total = va + vb + vc
    if total == 0.0:
        return 1.0, 0.0, 0.0
    v, w = vb / total, vc / total
    return 1.0 - v - w, v, w


@nb.njit(**INLINE)
def _face(work, i, j, k):
    """:func:`triangle_weights` of three points of the simplex, given by their offsets in the scratch."""
    return triangle_weights(
        work[i], work[i + 1], work[i + 2], work[j], work[j + 1], work[j + 2], work[k], work[k + 1], work[k + 2]
    )


@nb.njit(**INLINE)
def six_volumes(work, i, j, k, x0, x1, x2):
    """Six times the signed volume of a tetrahedron: three points of the simplex by their offsets, and x."""
    b0, b1, b2 = work[j] - work[i], work[j + 1] - work[i + 1], work[j + 2] - work[i + 2]
    c0, c1, c2 = work[k] - work[i], work[k + 1] - work[i + 1], work[k + 2] - work[i + 2]
    d0, d1, d2 = x0 - work[i], x1 - work[i + 1], x2 - work[i + 2]
    return b0 * (c1 * d2 - c2 * d1) - b1 * (c0 * d2 - c2 * d0) + b2 * (c0 * d1 - c1 * d0)


@nb.njit(**INLINE)
def cross(u0, u1, u2, w0, w1, w2):
    """Cross product of u and w."""
    return u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0


@nb.njit(**INLINE)
def is_flat(work, i, j, k, volume):
    """Whether the fourth point of a tetrahedron of six times this volume is in the plane of ijk but for rounding."""
    u0, u1, u2 = work[j] - work[i], work[j + 1] - work[i + 1], work[j + 2] - work[i + 2]
    w0, w1, w2 = work[k] - work[i], work[k + 1] - work[i + 1], work[k + 2] - work[i + 2]
    n0, n1, n2 = cross(u0, u1, u2, w0, w1, w2)
    return volume * volume <= FLAT * FLAT * (n0 * n0 + n1 * n1 + n2 * n2)


@nb.njit(**PLAIN)
def _tetrahedron_weights(work):
    """Weights of the point of the simplex' four points closest to the origin, into the scratch; True: it is inside."""
    w0, w1, w2, w3 = W, W + 3, W + 6, W + 9
    best = 1e300
    inside = True
    for f in range(4):
        # the origin is inside when it is on the inner side of all four faces
        i, j, k = (w1, w2, w3) if f == 0 else ((w0, w2, w3) if f == 1 else ((w0, w1, w3) if f == 2 else (w0, w1, w2)))
        o = W + 3 * f
        opposite = six_volumes(work, i, j, k, work[o], work[o + 1], work[o + 2])
        if opposite * six_volumes(work, i, j, k, 0.0, 0.0, 0.0) > 0.0 and not is_flat(work, i, j, k, opposite):
            continue
        inside = False
        x, y, z = _face(work, i, j, k)
        square = 0.0
        for c in range(3):
            value = x * work[i + c] + y * work[j + c] + z * work[k + c]
            square += value * value
        if square < best:
            best = square
            work[BARY + f] = 0.0
            work[BARY + (1 if f == 0 else 0)] = x
            work[BARY + (1 if f >= 2 else 2)] = y
            work[BARY + (2 if f == 3 else 3)] = z
    return inside


@nb.njit(**INLINE)
def reduce(work, guess, n):
    """Point of the simplex of n points closest to the origin, into the scratch's direction.

    Keeps only the vertices that carry it, with their weights and their indices in ``guess``. Returns (the new size, the
    squared distance); size 4 means that the origin is inside.
    """
    if n == 1:
        work[BARY] = 1.0
    elif n == 2:
        work[BARY], work[BARY + 1] = segment_weights(
            work[W], work[W + 1], work[W + 2], work[W + 3], work[W + 4], work[W + 5]
        )
    elif n == 3:
        work[BARY], work[BARY + 1], work[BARY + 2] = _face(work, W, W + 3, W + 6)
    elif _tetrahedron_weights(work):
        return 4, 0.0
    m = 0
    v0, v1, v2 = 0.0, 0.0, 0.0
    for i in range(n):
        weight = work[BARY + i]
        if weight > 0.0:
            if m != i:
                for x in range(3):
                    work[W + 3 * m + x] = work[W + 3 * i + x]
                    work[WA + 3 * m + x] = work[WA + 3 * i + x]
                    work[WB + 3 * m + x] = work[WB + 3 * i + x]
                guess[1 + m] = guess[1 + i]
                guess[5 + m] = guess[5 + i]
                work[BARY + m] = weight
            v0 += weight * work[W + 3 * m]
            v1 += weight * work[W + 3 * m + 1]
            v2 += weight * work[W + 3 * m + 2]
            m += 1
    work[V], work[V + 1], work[V + 2] = v0, v1, v2
    guess[0] = m
    return m, v0 * v0 + v1 * v1 + v2 * v2


@nb.njit(**INLINE)
def set_point(work, n, a0, a1, a2, b0, b1, b2):
    """Makes the points a of A and b of B the simplex' point number n."""
    o = 3 * n
    work[W + o], work[W + o + 1], work[W + o + 2] = a0 - b0, a1 - b1, a2 - b2
    work[WA + o], work[WA + o + 1], work[WA + o + 2] = a0, a1, a2
    work[WB + o], work[WB + o + 1], work[WB + o + 2] = b0, b1, b2
