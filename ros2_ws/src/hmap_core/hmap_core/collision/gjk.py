"""Signed distance of two convex shapes: GJK outside, EPA inside.

A shape is the convex hull of vertices swept by a sphere: a box is 8 vertices and radius 0, a sphere one vertex and its
radius, a capsule two. Outside, the distance of the cores is found by GJK [1] with closest-point sub-problems after
[2]; in overlap the penetration depth is found by the expanding polytope algorithm [3], so the value keeps growing and
its gradient keeps its meaning however deep the overlap is. Between configurations that differ little the last simplex
is nearly right, and the farthest vertex is found by climbing along the hull's edges from the last one.

[1] Gilbert, Johnson, Keerthi 1988. [2] Ericson, Real-Time Collision Detection, 2005, ch. 5. [3] van den Bergen 2001.
"""

import numba as nb
import numpy as np

OPTIONS = dict(cache=True, fastmath=False, error_model="numpy", nogil=True, _nrt=True)
# Functions that allocate nothing: without counting references to arrays, which would take a third of their time.
PLAIN = dict(OPTIONS, _nrt=False)
INLINE = dict(PLAIN, forceinline=True)  # what is called so often that passing arrays would cost more than the work
MAX_ITERATIONS = 48
RELATIVE_GAP = 1e-7  # of the squared distance, where GJK stops
TOUCHING = 1e-9  # m: cores nearer than this count as overlapping
EPA_GAP = 1e-7  # m: accuracy of the penetration depth
EPA_VERTICES = 64
EPA_FACES = 192
FAR = 1e9
FLAT = 1e-12  # m: four points of which none is farther than this from the plane of the others have no inside
# offsets into the scratch: direction, simplex of A - B, its points on A and on B (4 each), their weights
V, W, WA, WB, BARY = 0, 3, 15, 27, 39
WORK = 60  # numbers of the scratch


@nb.njit(**INLINE)
def _point(P, R, p, index):
    """Vertex ``index`` of (P, R, p) in the world frame."""
    v0, v1, v2 = P[index, 0], P[index, 1], P[index, 2]
    return (
        R[0, 0] * v0 + R[0, 1] * v1 + R[0, 2] * v2 + p[0],
        R[1, 0] * v0 + R[1, 1] * v1 + R[1, 2] * v2 + p[1],
        R[2, 0] * v0 + R[2, 1] * v1 + R[2, 2] * v2 + p[2],
    )


@nb.njit(**INLINE)
def _support(P, edges, start, R, d0, d1, d2):
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
def _segment(a0, a1, a2, b0, b1, b2):
    """Weights of the point of segment ab closest to the origin."""
    u0, u1, u2 = b0 - a0, b1 - a1, b2 - a2
    denominator = u0 * u0 + u1 * u1 + u2 * u2
    t = 0.0
    if denominator > 0.0:
        t = -(a0 * u0 + a1 * u1 + a2 * u2) / denominator
    t = min(1.0, max(0.0, t))
    return 1.0 - t, t


@nb.njit(**PLAIN)
def _triangle(a0, a1, a2, b0, b1, b2, c0, c1, c2):
    """Weights of the point of triangle abc closest to the origin [2, 5.1.5]."""
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
    """:func:`_triangle` of three points of the simplex, given by their offsets in the scratch."""
    return _triangle(
        work[i], work[i + 1], work[i + 2], work[j], work[j + 1], work[j + 2], work[k], work[k + 1], work[k + 2]
    )


@nb.njit(**INLINE)
def _volume(work, i, j, k, x0, x1, x2):
    """Six times the signed volume of a tetrahedron: three points of the simplex by their offsets, and x."""
    b0, b1, b2 = work[j] - work[i], work[j + 1] - work[i + 1], work[j + 2] - work[i + 2]
    c0, c1, c2 = work[k] - work[i], work[k + 1] - work[i + 1], work[k + 2] - work[i + 2]
    d0, d1, d2 = x0 - work[i], x1 - work[i + 1], x2 - work[i + 2]
    return b0 * (c1 * d2 - c2 * d1) - b1 * (c0 * d2 - c2 * d0) + b2 * (c0 * d1 - c1 * d0)


@nb.njit(**INLINE)
def _cross(u0, u1, u2, w0, w1, w2):
    return u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0


@nb.njit(**INLINE)
def _is_flat(work, i, j, k, volume):
    """Whether the fourth point of a tetrahedron of six times this volume is in the plane of ijk but for rounding."""
    u0, u1, u2 = work[j] - work[i], work[j + 1] - work[i + 1], work[j + 2] - work[i + 2]
    w0, w1, w2 = work[k] - work[i], work[k + 1] - work[i + 1], work[k + 2] - work[i + 2]
    n0, n1, n2 = _cross(u0, u1, u2, w0, w1, w2)
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
        opposite = _volume(work, i, j, k, work[o], work[o + 1], work[o + 2])
        if opposite * _volume(work, i, j, k, 0.0, 0.0, 0.0) > 0.0 and not _is_flat(work, i, j, k, opposite):
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
def _reduce(work, guess, n):
    """Point of the simplex of n points closest to the origin, into the scratch's direction.

    Keeps only the vertices that carry it, with their weights and their indices in ``guess``. Returns (the new size, the
    squared distance); size 4 means that the origin is inside.
    """
    if n == 1:
        work[BARY] = 1.0
    elif n == 2:
        work[BARY], work[BARY + 1] = _segment(work[W], work[W + 1], work[W + 2], work[W + 3], work[W + 4], work[W + 5])
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
def _put(work, n, a0, a1, a2, b0, b1, b2):
    """Makes the points a of A and b of B the simplex' point number n."""
    o = 3 * n
    work[W + o], work[W + o + 1], work[W + o + 2] = a0 - b0, a1 - b1, a2 - b2
    work[WA + o], work[WA + o + 1], work[WA + o + 2] = a0, a1, a2
    work[WB + o], work[WB + o + 1], work[WB + o + 2] = b0, b1, b2


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
            a0, a1, a2 = _point(VA, RA, pA, guess[1 + i])
            b0, b1, b2 = _point(VB, RB, pB, guess[5 + i])
            _put(work, i, a0, a1, a2, b0, b1, b2)
        n, vv = _reduce(work, guess, n)
        if n == 4:
            guess[0] = 4
            return 4, 0.0
        if vv <= TOUCHING * TOUCHING:
            return n, 0.0
    for _ in range(MAX_ITERATIONS):
        v0, v1, v2 = work[V], work[V + 1], work[V + 2]
        last = max(n - 1, 0)
        ia = _support(VA, EA, guess[1 + last], RA, -v0, -v1, -v2)
        ib = _support(VB, EB, guess[5 + last], RB, v0, v1, v2)
        a0, a1, a2 = _point(VA, RA, pA, ia)
        b0, b1, b2 = _point(VB, RB, pB, ib)
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
        _put(work, n, a0, a1, a2, b0, b1, b2)
        guess[1 + n] = ia
        guess[5 + n] = ib
        n, new = _reduce(work, guess, n + 1)
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


@nb.njit(**INLINE)
def _plane(P, i, j, k):
    """Unit normal of the triangle of the rows i, j, k of P and its distance from the origin; -1 when degenerate."""
    u0, u1, u2 = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
    w0, w1, w2 = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
    n0, n1, n2 = _cross(u0, u1, u2, w0, w1, w2)
    length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if length < 1e-16:
        return 0.0, 0.0, 0.0, -1.0
    n0, n1, n2 = n0 / length, n1 / length, n2 / length
    return n0, n1, n2, n0 * P[i, 0] + n1 * P[i, 1] + n2 * P[i, 2]


@nb.njit(**OPTIONS)
def _tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, work, n):
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
        a0, a1, a2 = _point(VA, RA, pA, _support(VA, EA, 0, RA, d0, d1, d2))
        b0, b1, b2 = _point(VB, RB, pB, _support(VB, EB, 0, RB, -d0, -d1, -d2))
        _put(work, n, a0, a1, a2, b0, b1, b2)
        if n == 0:
            n = 1
        elif n == 1:
            if (P[1, 0] - P[0, 0]) ** 2 + (P[1, 1] - P[0, 1]) ** 2 + (P[1, 2] - P[0, 2]) ** 2 > 1e-16:
                n = 2
        elif n == 2:
            if _plane(P, 0, 1, 2)[3] != -1.0:
                n = 3
        elif not _is_flat(work, W, W + 3, W + 6, _volume(work, W, W + 3, W + 6, P[3, 0], P[3, 1], P[3, 2])):
            n = 4
    return n


@nb.njit(**PLAIN)
def _add_face(P, F, N, m, i, j, k):
    """Writes the triangle i, j, k as face m: its vertices to F, its outward normal and distance to N."""
    n0, n1, n2, d = _plane(P, i, j, k)
    F[m, 0], F[m, 1], F[m, 2] = i, j, k
    N[m, 0], N[m, 1], N[m, 2], N[m, 3] = n0, n1, n2, d


@nb.njit(**OPTIONS)
def _epa(VA, EA, RA, pA, VB, EB, RB, pB, guess, work, witness):
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
        if _volume(work, W + 3 * i, W + 3 * j, W + 3 * k, P[f, 0], P[f, 1], P[f, 2]) > 0.0:
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
        ia = _support(VA, EA, ia, RA, n0, n1, n2)
        ib = _support(VB, EB, ib, RB, -n0, -n1, -n2)
        a0, a1, a2 = _point(VA, RA, pA, ia)
        b0, b1, b2 = _point(VB, RB, pB, ib)
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
        x, y, z = _triangle(
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
        n = _tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, work, n)
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
    depth = _epa(VA, EA, RA, pA, VB, EB, RB, pB, guess, work, witness)
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
