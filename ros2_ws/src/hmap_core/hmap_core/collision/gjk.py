"""Signed distance of two convex shapes: GJK outside, EPA inside.

A shape is the convex hull of vertices swept by a sphere: a box is 8 vertices and radius 0, a sphere one vertex and its
radius, a capsule two. Between configurations that differ little the last simplex is nearly right, and the farthest
vertex is found by climbing along the hull's edges from the last one. Outside, the distance of the cores is found by GJK [1] with closest-point sub-problems after
[2]; in overlap the penetration depth is found by the expanding polytope algorithm [3], so the value keeps growing and
its gradient keeps its meaning however deep the overlap is.

[1] Gilbert, Johnson, Keerthi 1988. [2] Ericson, Real-Time Collision Detection, 2005, ch. 5. [3] van den Bergen 2001.
"""

import numba as nb
import numpy as np

OPTIONS = dict(cache=True, fastmath=False, error_model="numpy", nogil=True)
MAX_ITERATIONS = 48
RELATIVE_GAP = 1e-7  # of the squared distance, where GJK stops
TOUCHING = 1e-9  # m: cores nearer than this count as overlapping
EPA_GAP = 1e-7  # m: accuracy of the penetration depth
EPA_VERTICES = 64
EPA_FACES = 192
FAR = 1e9


@nb.njit(**OPTIONS)
def _point(V, R, p, index, out):
    """Vertex ``index`` of (V, R, p) in the world frame, written to out (3,)."""
    v0, v1, v2 = V[index, 0], V[index, 1], V[index, 2]
    out[0] = R[0, 0] * v0 + R[0, 1] * v1 + R[0, 2] * v2 + p[0]
    out[1] = R[1, 0] * v0 + R[1, 1] * v1 + R[1, 2] * v2 + p[1]
    out[2] = R[2, 0] * v0 + R[2, 1] * v1 + R[2, 2] * v2 + p[2]


@nb.njit(**OPTIONS)
def _support(V, edges, start, R, p, d0, d1, d2, out):
    """Vertex of (V, R, p) farthest along the world direction d, written to out (3,); returns its index.

    With ``edges`` it climbs from vertex ``start`` along the hull's edges, else it looks at every vertex.
    """
    l0 = R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2
    l1 = R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2
    l2 = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
    n = V.shape[0]
    index = 0
    if edges.shape[0] == 0:
        best = -1e300
        for i in range(n):
            value = V[i, 0] * l0 + V[i, 1] * l1 + V[i, 2] * l2
            if value > best:
                best = value
                index = i
    else:
        index = start
        best = V[index, 0] * l0 + V[index, 1] * l1 + V[index, 2] * l2
        here = -1
        while here != index:
            here = index
            for e in range(edges[here], edges[here + 1]):
                i = edges[e]
                value = V[i, 0] * l0 + V[i, 1] * l1 + V[i, 2] * l2
                if value > best:
                    best = value
                    index = i
    _point(V, R, p, index, out)
    return index


@nb.njit(**OPTIONS)
def _segment(a, b, bary):
    """Closest point of segment ab to the origin as barycentric coordinates (2,)."""
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    denominator = ab0 * ab0 + ab1 * ab1 + ab2 * ab2
    t = 0.0
    if denominator > 0.0:
        t = -(a[0] * ab0 + a[1] * ab1 + a[2] * ab2) / denominator
    t = min(1.0, max(0.0, t))
    bary[0] = 1.0 - t
    bary[1] = t


@nb.njit(**OPTIONS)
def _triangle(a, b, c, bary):
    """Closest point of triangle abc to the origin as barycentric coordinates (3,) [2, 5.1.5]."""
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    d1 = -(ab0 * a[0] + ab1 * a[1] + ab2 * a[2])
    d2 = -(ac0 * a[0] + ac1 * a[1] + ac2 * a[2])
    bary[0] = 0.0
    bary[1] = 0.0
    bary[2] = 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        bary[0] = 1.0
        return
    d3 = -(ab0 * b[0] + ab1 * b[1] + ab2 * b[2])
    d4 = -(ac0 * b[0] + ac1 * b[1] + ac2 * b[2])
    if d3 >= 0.0 and d4 <= d3:
        bary[1] = 1.0
        return
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3) if d1 != d3 else 0.0
        bary[0] = 1.0 - v
        bary[1] = v
        return
    d5 = -(ab0 * c[0] + ab1 * c[1] + ab2 * c[2])
    d6 = -(ac0 * c[0] + ac1 * c[1] + ac2 * c[2])
    if d6 >= 0.0 and d5 <= d6:
        bary[2] = 1.0
        return
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6) if d2 != d6 else 0.0
        bary[0] = 1.0 - w
        bary[2] = w
        return
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        total = (d4 - d3) + (d5 - d6)
        w = (d4 - d3) / total if total > 0.0 else 0.0
        bary[1] = 1.0 - w
        bary[2] = w
        return
    total = va + vb + vc
    if total == 0.0:
        bary[0] = 1.0
        return
    bary[1] = vb / total
    bary[2] = vc / total
    bary[0] = 1.0 - bary[1] - bary[2]


@nb.njit(**OPTIONS)
def _volume(a, b, c, d):
    """Six times the signed volume of tetrahedron abcd."""
    b0, b1, b2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    c0, c1, c2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    d0, d1, d2 = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return b0 * (c1 * d2 - c2 * d1) - b1 * (c0 * d2 - c2 * d0) + b2 * (c0 * d1 - c1 * d0)


@nb.njit(**OPTIONS)
def _reduce(W, WA, WB, hint, n, bary, face, point, origin):
    """Closest point of the simplex W[:n] to the origin; keeps only its supporting vertices, and their indices in hint.

    Returns the new size; ``bary`` holds their weights. Size 4 means that the origin is inside.
    """
    if n == 1:
        bary[0] = 1.0
        return 1
    if n == 2:
        _segment(W[0], W[1], bary)
    elif n == 3:
        _triangle(W[0], W[1], W[2], bary)
    else:
        # the origin is inside when it is on the inner side of all four faces
        best = 1e300
        inside = True
        b0 = b1 = b2 = b3 = 0.0
        for f in range(4):
            i, j, k = (1, 2, 3) if f == 0 else ((0, 2, 3) if f == 1 else ((0, 1, 3) if f == 2 else (0, 1, 2)))
            opposite = _volume(W[i], W[j], W[k], W[f])
            side = _volume(W[i], W[j], W[k], origin)
            if opposite * side > 0.0 and abs(opposite) > 1e-300:
                continue
            inside = False
            _triangle(W[i], W[j], W[k], face)
            square = 0.0
            for x in range(3):
                point[x] = face[0] * W[i, x] + face[1] * W[j, x] + face[2] * W[k, x]
                square += point[x] * point[x]
            if square < best:
                best = square
                b0 = 0.0
                b1 = 0.0
                b2 = 0.0
                b3 = 0.0
                if f == 0:
                    b1, b2, b3 = face[0], face[1], face[2]
                elif f == 1:
                    b0, b2, b3 = face[0], face[1], face[2]
                elif f == 2:
                    b0, b1, b3 = face[0], face[1], face[2]
                else:
                    b0, b1, b2 = face[0], face[1], face[2]
        if inside:
            return 4
        bary[0] = b0
        bary[1] = b1
        bary[2] = b2
        bary[3] = b3
    m = 0
    for i in range(n):
        if bary[i] > 0.0:
            if m != i:
                for x in range(3):
                    W[m, x] = W[i, x]
                    WA[m, x] = WA[i, x]
                    WB[m, x] = WB[i, x]
                hint[1 + m] = hint[1 + i]
                hint[5 + m] = hint[5 + i]
                bary[m] = bary[i]
            m += 1
    return m


@nb.njit(**OPTIONS)
def _gjk(VA, EA, RA, pA, VB, EB, RB, pB, cutoff, hint, W, WA, WB, v, tmp, bary):
    """Closest points of two cores. Returns (simplex size, distance or a lower bound beyond cutoff).

    Size 0: farther apart than ``cutoff`` (the distance returned is a lower bound, v the separating direction).
    Size 4, or distance 0: overlapping. The simplex of the last call, in ``hint``, is where it starts.
    """
    a = tmp[0]
    b = tmp[1]
    n = hint[0]
    vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    first = n == 0
    if not first:
        for i in range(n):
            _point(VA, RA, pA, hint[1 + i], WA[i])
            _point(VB, RB, pB, hint[5 + i], WB[i])
            for x in range(3):
                W[i, x] = WA[i, x] - WB[i, x]
        n = _reduce(W, WA, WB, hint, n, bary, tmp[2], tmp[3], tmp[4])
        hint[0] = n
        if n == 4:
            return 4, 0.0
        v[0] = 0.0
        v[1] = 0.0
        v[2] = 0.0
        for i in range(n):
            for x in range(3):
                v[x] += bary[i] * W[i, x]
        vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        if vv <= TOUCHING * TOUCHING:
            return n, 0.0
    elif vv < 1e-18:
        v[0] = 1.0
        v[1] = 0.0
        v[2] = 0.0
        vv = 1.0
    if first:
        hint[1] = 0
        hint[5] = 0
    for _ in range(MAX_ITERATIONS):
        last = max(n - 1, 0)
        ia = _support(VA, EA, hint[1 + last], RA, pA, -v[0], -v[1], -v[2], a)
        ib = _support(VB, EB, hint[5 + last], RB, pB, v[0], v[1], v[2], b)
        w0, w1, w2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        vw = v[0] * w0 + v[1] * w1 + v[2] * w2
        if vw > 0.0 and vw * vw > cutoff * cutoff * vv:
            if n == 0:
                hint[0] = 1
                hint[1] = ia
                hint[5] = ib
            return 0, vw / np.sqrt(vv)
        if not first and vv - vw <= RELATIVE_GAP * vv:
            break
        seen = False
        for i in range(n):
            if hint[1 + i] == ia and hint[5 + i] == ib:
                seen = True
        if seen:
            break
        W[n, 0] = w0
        W[n, 1] = w1
        W[n, 2] = w2
        for x in range(3):
            WA[n, x] = a[x]
            WB[n, x] = b[x]
        hint[1 + n] = ia
        hint[5 + n] = ib
        n += 1
        n = _reduce(W, WA, WB, hint, n, bary, tmp[2], tmp[3], tmp[4])
        hint[0] = n
        if n == 4:
            return 4, 0.0
        v[0] = 0.0
        v[1] = 0.0
        v[2] = 0.0
        for i in range(n):
            for x in range(3):
                v[x] += bary[i] * W[i, x]
        new = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        if new <= TOUCHING * TOUCHING:
            return n, 0.0
        if not first and new >= vv:
            vv = new
            break
        vv = new
        first = False
    return n, np.sqrt(vv)


@nb.njit(**OPTIONS)
def _face_normal(P, i, j, k, out):
    """Unit normal of triangle ijk of P into out (3,), its distance from the origin; -1 when degenerate."""
    u0, u1, u2 = P[j, 0] - P[i, 0], P[j, 1] - P[i, 1], P[j, 2] - P[i, 2]
    w0, w1, w2 = P[k, 0] - P[i, 0], P[k, 1] - P[i, 1], P[k, 2] - P[i, 2]
    n0 = u1 * w2 - u2 * w1
    n1 = u2 * w0 - u0 * w2
    n2 = u0 * w1 - u1 * w0
    length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if length < 1e-16:
        return -1.0
    out[0] = n0 / length
    out[1] = n1 / length
    out[2] = n2 / length
    return out[0] * P[i, 0] + out[1] * P[i, 1] + out[2] * P[i, 2]


@nb.njit(**OPTIONS)
def _tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, W, WA, WB, n, tmp):
    """Grows a simplex of n < 4 points that contains the origin to a tetrahedron with volume; returns its size."""
    directions = np.array(
        [
            [1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0], [0, 0, -1.0],
            [0.6, 0.6, 0.53], [-0.6, 0.53, 0.6], [0.53, -0.6, -0.6], [-0.53, -0.6, 0.6],
        ]
    )  # fmt: skip
    a = tmp[0]
    b = tmp[1]
    normal = tmp[2]
    for d in range(directions.shape[0] + 2):
        if n == 4:
            return 4
        if n == 3:
            # the two normals of the triangle first, they are the best bet
            _face_normal(W, 0, 1, 2, normal)
            sign = 1.0 if d % 2 == 0 else -1.0
            d0, d1, d2 = sign * normal[0], sign * normal[1], sign * normal[2]
        else:
            k = d % directions.shape[0]
            d0, d1, d2 = directions[k, 0], directions[k, 1], directions[k, 2]
        _support(VA, EA, 0, RA, pA, d0, d1, d2, a)
        _support(VB, EB, 0, RB, pB, -d0, -d1, -d2, b)
        for x in range(3):
            W[n, x] = a[x] - b[x]
            WA[n, x] = a[x]
            WB[n, x] = b[x]
        if n == 0:
            n = 1
        elif n == 1:
            s = 0.0
            for x in range(3):
                s += (W[1, x] - W[0, x]) ** 2
            if s > 1e-16:
                n = 2
        elif n == 2:
            if _face_normal(W, 0, 1, 2, normal) != -1.0:
                n = 3
        elif abs(_volume(W[0], W[1], W[2], W[3])) > 1e-16:
            n = 4
    return n


@nb.njit(**OPTIONS)
def _epa(VA, EA, RA, pA, VB, EB, RB, pB, hint, W, WA, WB, tmp, normal, point_a, point_b):
    """Penetration depth of two overlapping cores from a tetrahedron W round the origin; normal: from A into B."""
    P = np.empty((EPA_VERTICES, 3))
    PA = np.empty((EPA_VERTICES, 3))
    PB = np.empty((EPA_VERTICES, 3))
    F = np.empty((EPA_FACES, 3), np.int64)
    N = np.empty((EPA_FACES, 3))
    D = np.empty(EPA_FACES)
    E = np.empty((EPA_FACES * 3, 2), np.int64)
    for i in range(4):
        for x in range(3):
            P[i, x] = W[i, x]
            PA[i, x] = WA[i, x]
            PB[i, x] = WB[i, x]
    n = 4
    m = 0
    for f in range(4):
        i, j, k = (1, 2, 3) if f == 0 else ((0, 3, 2) if f == 1 else ((0, 1, 3) if f == 2 else (0, 2, 1)))
        if _volume(P[i], P[j], P[k], P[f]) > 0.0:
            i, j = j, i
        F[m, 0] = i
        F[m, 1] = j
        F[m, 2] = k
        D[m] = _face_normal(P, i, j, k, N[m])
        m += 1
    best = 0
    a = tmp[0]
    b = tmp[1]
    for _ in range(EPA_VERTICES):
        best = 0
        for f in range(1, m):
            if D[f] < D[best]:
                best = f
        _support(VA, EA, hint[1], RA, pA, N[best, 0], N[best, 1], N[best, 2], a)
        _support(VB, EB, hint[5], RB, pB, -N[best, 0], -N[best, 1], -N[best, 2], b)
        reach = 0.0
        for x in range(3):
            reach += N[best, x] * (a[x] - b[x])
        if reach - D[best] <= EPA_GAP or n == EPA_VERTICES:
            break
        for x in range(3):
            P[n, x] = a[x] - b[x]
            PA[n, x] = a[x]
            PB[n, x] = b[x]
        # remove the faces that the new point sees, and join their rim to it
        edges = 0
        kept = 0
        for f in range(m):
            visible = 0.0
            for x in range(3):
                visible += N[f, x] * (P[n, x] - P[F[f, 0], x])
            if visible > 1e-12:
                for e in range(3):
                    u = F[f, e]
                    w = F[f, (e + 1) % 3]
                    twin = -1
                    for g in range(edges):
                        if E[g, 0] == w and E[g, 1] == u:
                            twin = g
                            break
                    if twin >= 0:
                        edges -= 1
                        E[twin, 0] = E[edges, 0]
                        E[twin, 1] = E[edges, 1]
                    else:
                        E[edges, 0] = u
                        E[edges, 1] = w
                        edges += 1
            else:
                if kept != f:
                    for x in range(3):
                        F[kept, x] = F[f, x]
                        N[kept, x] = N[f, x]
                    D[kept] = D[f]
                kept += 1
        if edges == 0 or kept + edges > EPA_FACES:
            break
        m = kept
        for g in range(edges):
            F[m, 0] = E[g, 0]
            F[m, 1] = E[g, 1]
            F[m, 2] = n
            D[m] = _face_normal(P, E[g, 0], E[g, 1], n, N[m])
            if D[m] < -0.5:
                D[m] = FAR
            m += 1
        n += 1
    # of the triangles of the nearest plane, the one that holds the foot of the origin: only its points are opposite
    bary = tmp[2]
    shifted = np.empty((3, 3))
    depth = D[best]
    off = FAR
    chosen = best
    for f in range(m):
        if D[f] > depth + EPA_GAP:
            continue
        i, j, k = F[f, 0], F[f, 1], F[f, 2]
        for x in range(3):
            shifted[0, x] = P[i, x] - D[f] * N[f, x]
            shifted[1, x] = P[j, x] - D[f] * N[f, x]
            shifted[2, x] = P[k, x] - D[f] * N[f, x]
        _triangle(shifted[0], shifted[1], shifted[2], bary)
        square = 0.0
        for x in range(3):
            square += (bary[0] * shifted[0, x] + bary[1] * shifted[1, x] + bary[2] * shifted[2, x]) ** 2
        if square < off:
            off = square
            chosen = f
    best = chosen
    i, j, k = F[best, 0], F[best, 1], F[best, 2]
    for x in range(3):
        shifted[0, x] = P[i, x] - D[best] * N[best, x]
        shifted[1, x] = P[j, x] - D[best] * N[best, x]
        shifted[2, x] = P[k, x] - D[best] * N[best, x]
    _triangle(shifted[0], shifted[1], shifted[2], bary)
    for x in range(3):
        normal[x] = N[best, x]
        point_a[x] = bary[0] * PA[i, x] + bary[1] * PA[j, x] + bary[2] * PA[k, x]
        point_b[x] = bary[0] * PB[i, x] + bary[1] * PB[j, x] + bary[2] * PB[k, x]
    return max(0.0, D[best])


@nb.njit(**OPTIONS)
def distance_from(VA, EA, RA, pA, rA, VB, EB, RB, pB, rB, cutoff, hint, witness, work):
    """:func:`distance_within` that starts from what it found last time.

    Args:
        EA, EB: edges of the hulls (see :func:`hmap_core.collision.edges.hull_edges`), or empty.
        hint: (9,) size of the last simplex, its vertices of A (4,), of B (4,); read and written. Size 0: none.
        work: scratch (20, 3); ``work[0]`` is the direction to start with where there is no hint.
    """
    W = work[1:5]
    WA = work[5:9]
    WB = work[9:13]
    v = work[0]
    tmp = work[13:18]
    bary = work[18:20].reshape(6)
    tmp[4, 0] = 0.0
    tmp[4, 1] = 0.0
    tmp[4, 2] = 0.0
    radius = rA + rB
    n, d = _gjk(VA, EA, RA, pA, VB, EB, RB, pB, cutoff + radius, hint, W, WA, WB, v, tmp, bary)
    if n == 0:
        return d - radius
    if n < 4 and d > 0.0:
        for x in range(3):
            witness[0, x] = v[x] / d
            pa = 0.0
            pb = 0.0
            for i in range(n):
                pa += bary[i] * WA[i, x]
                pb += bary[i] * WB[i, x]
            witness[1, x] = pa - rA * witness[0, x]
            witness[2, x] = pb + rB * witness[0, x]
        return d - radius
    if n < 4:
        n = _tetrahedron(VA, EA, RA, pA, VB, EB, RB, pB, W, WA, WB, n, tmp)
        hint[0] = 0  # the vertices that were added have no place in it
        hint[1] = 0
        hint[5] = 0
    if n < 4:
        # both cores lie in one plane or line: they touch, with no depth to speak of
        for x in range(3):
            witness[0, x] = 1.0 if x == 2 else 0.0
            witness[1, x] = WA[0, x]
            witness[2, x] = WB[0, x]
        return -radius
    depth = _epa(VA, EA, RA, pA, VB, EB, RB, pB, hint, W, WA, WB, tmp, witness[0], witness[1], witness[2])
    for x in range(3):
        witness[0, x] = -witness[0, x]
        v[x] = witness[0, x]
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
        work: scratch (20, 3); ``work[0]`` is the direction to start with (the last separating one makes it fast).

    Returns:
        Distance in metres, negative by the penetration depth.
    """
    none = np.empty(0, np.int32)
    hint = np.zeros(9, np.int16)
    return distance_from(VA, none, RA, pA, rA, VB, none, RB, pB, rB, cutoff, hint, witness, work)


@nb.njit(**OPTIONS)
def signed_distance(VA, RA, pA, rA, VB, RB, pB, rB, witness):
    """:func:`distance_within` without a cutoff."""
    work = np.zeros((20, 3))
    work[0, :] = pA - pB
    return distance_within(VA, RA, pA, rA, VB, RB, pB, rB, FAR, witness, work)
