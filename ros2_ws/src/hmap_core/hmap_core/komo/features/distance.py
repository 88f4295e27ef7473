"""Signed distance between two bodies that hang on any two frames."""

import numpy as np
from numba import carray, cfunc

from hmap_core.collision.convex import ConvexSet
from hmap_core.collision.epa import FAR
from hmap_core.collision.gjk import distance_within
from hmap_core.collision.simplex import WORK
from hmap_core.exceptions import InputError
from hmap_core.kinematics.tree import point_jacobian
from hmap_core.komo.features.base import CALLBACK, KERNEL, Feature

_HEADER = 5  # numbers before the pieces: numbers in all, pieces of the first set, of the second, factor, constant
_PIECE = 7  # of a piece: where its vertices begin, how many, radius, centre (3) and radius of the bounding sphere


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames, r, J = carray(frames_, 2), carray(r_, 1), carray(J_, (1, n))
    header = carray(params_, _HEADER)
    numbers, pieces_a, pieces_b = carray(params_, int(header[0])), int(header[1]), int(header[2])
    a, b = frames[0], frames[1]
    Ra, Rb, pa, pb = R[a], R[b], p[a], p[b]
    witness, nearest, work = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(WORK)
    best = FAR
    for i in range(pieces_a):
        A = numbers[_HEADER + _PIECE * i : _HEADER + _PIECE * (i + 1)]
        VA = numbers[int(A[0]) : int(A[0]) + 3 * int(A[1])].reshape(int(A[1]), 3)
        for j in range(pieces_a, pieces_a + pieces_b):
            B = numbers[_HEADER + _PIECE * j : _HEADER + _PIECE * (j + 1)]
            square = 0.0
            for x in range(3):
                u = Ra[x, 0] * A[3] + Ra[x, 1] * A[4] + Ra[x, 2] * A[5] + pa[x]
                w = Rb[x, 0] * B[3] + Rb[x, 1] * B[4] + Rb[x, 2] * B[5] + pb[x]
                work[x] = u - w
                square += (u - w) * (u - w)
            if np.sqrt(square) - A[6] - B[6] >= best:
                continue
            VB = numbers[int(B[0]) : int(B[0]) + 3 * int(B[1])].reshape(int(B[1]), 3)
            d = distance_within(VA, Ra, pa, A[2], VB, Rb, pb, B[2], best, witness, work)
            if d < best:
                best = d
                for y in range(3):
                    for x in range(3):
                        nearest[y, x] = witness[y, x]
    factor = header[3]
    r[0] = header[4] + factor * best
    w = nearest
    point_jacobian(R, p, first, prismatic, a, w[1, 0], w[1, 1], w[1, 2], w[0, 0], w[0, 1], w[0, 2], factor, J[0])
    point_jacobian(R, p, first, prismatic, b, w[2, 0], w[2, 1], w[2, 2], w[0, 0], w[0, 1], w[0, 2], -factor, J[0])


def _pack(sets: tuple[ConvexSet, ConvexSet], factor: float, constant: float) -> np.ndarray:
    """The numbers that the kernel takes: header, pieces of both sets, vertices; for factor * distance + constant.

    Raises:
        InputError: a set without pieces.
    """
    for which, shapes in zip(("first", "second"), sets, strict=True):
        if len(shapes) == 0:
            raise InputError(f"distance: the {which} body has no pieces; allowed: one or more")
    pieces, vertices = [], []
    begin = _HEADER + _PIECE * sum(len(shapes) for shapes in sets)
    for shapes in sets:
        for s in range(len(shapes)):
            hull = shapes.hull(s)
            pieces.append(np.r_[begin, len(hull), shapes.radius[s], shapes.center[s], shapes.bound[s]])
            vertices.append(hull.reshape(-1))
            begin += hull.size
    header = [begin, len(sets[0]), len(sets[1]), factor, constant]
    return np.concatenate([header, *pieces, *vertices]).astype(float)


def distance(frame: int, shapes: ConvexSet, reference: int, reference_shapes: ConvexSet) -> Feature:
    """Signed distance (1,) in metres between two bodies: the smallest over their pieces, negative by the depth inside.

    As an equality it is KOMO's ``touch``. The derivative is that of the nearest points along their common normal: exact
    where the nearest points are unique or lie on parallel faces, one of several where the nearest piece changes or, in
    overlap, the nearest face.

    Args:
        frame: frame that carries ``shapes``: a link, what it holds, a free body, or 0 for what stands in the world.
        shapes: convex pieces in the coordinates of that frame.
        reference, reference_shapes: the same of the other body.

    Raises:
        InputError: a body without pieces.
    """
    params = _pack((shapes, reference_shapes), 1.0, 0.0)
    return Feature("distance", _kernel.address, 1, (frame, reference), params, "m")


def clearance(frame: int, shapes: ConvexSet, reference: int, reference_shapes: ConvexSet, min_distance: float = 0.0):
    """minimum distance - distance, (1,), m: not above zero, as an inequality, where two bodies keep ``min_distance``
    metres apart.

    The pairs of a CollisionModel do it faster, and between the steps too; this is for single steps and as a cost.
    Arguments and errors as of :func:`distance`.
    """
    params = _pack((shapes, reference_shapes), -1.0, min_distance)
    return Feature("clearance", _kernel.address, 1, (frame, reference), params, "m")
