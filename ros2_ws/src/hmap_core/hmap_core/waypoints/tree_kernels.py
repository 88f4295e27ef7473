"""Compiled collision checks of a body of many parts, or among many obstacle shapes: the broad phase of ``kernels``.

Both sides have a tree of boxes (:mod:`hmap_core.collision.bvh`): the body's in its frame, the obstacles' in the world
frame. The trees are traversed together, and only pairs of leaves whose boxes are near reach the exact checks. For a
motion, a traversal also halves the time: a pair of nodes is clear for an interval if the distance of the boxes in its
middle exceeds what the body's node can move within half of it (Redon, Kheddar & Coquillart, "Fast continuous collision
detection between rigid bodies", Eurographics 2002; Tang, Kim & Manocha, ICRA 2009). The checks are those of
``kernels``: whole motions, exact for the pairs.

``shapes`` are the arrays of ``kernels``, from VA to upper; ``trees`` the trees of body and obstacles. Every function
ends at the ``deadline`` (s, of ``clock.now``), and then reports what is on the safe side.
"""

import numpy as np
from numba import njit

from hmap_core.clock import now
from hmap_core.collision.epa import FAR
from hmap_core.waypoints.kernels import (
    RESOLUTION,
    STACK,
    farthest,
    gjk_scratch,
    pair_distance,
    pair_free,
    rotation,
    screw,
    turned,
)

# a motion is halved at most this often before its leaves are checked
LEVELS = 7
# poses of these intervals; interval 1 is the whole motion, k has the halves 2 k and 2 k + 1
_INTERVALS = 2 ** (LEVELS + 1)
# poses along a motion that are checked first, because most blocked motions are found there: at this distance, m
SAMPLE_STEP = 0.02
# they are halved at most this often
SAMPLE_LEVELS = 5
# capacity of the stack of pairs: two trees, and the halves of the time
_PAIRS = 512
# pairs of nodes between two looks at the clock
LOOK = 256
TIMED_OUT = -2  # in place of the index of an obstacle


@njit(cache=True, error_model="numpy", nogil=True)
def new_scratch():
    """Memory of the checks, made once: stack of node pairs, poses of intervals, and memory of the exact checks."""
    return (
        np.empty((_PAIRS, 3), np.int64), np.empty((_INTERVALS, 3, 3)), np.empty((_INTERVALS, 3)),
        np.zeros(_INTERVALS, np.bool_), np.empty((STACK + 2, 2)), gjk_scratch(), np.empty((3, 3)), np.empty(3),
        np.eye(3), np.zeros(3),
    )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _gap(cA, hA, R, p, cB, hB):
    """Lower bound of the distance of a box in the frame (R, p) from a box in the world frame; 0 if they may overlap.

    The boxes are compared along the axes of both frames.
    """
    d0 = R[0, 0] * cA[0] + R[0, 1] * cA[1] + R[0, 2] * cA[2] + p[0] - cB[0]
    d1 = R[1, 0] * cA[0] + R[1, 1] * cA[1] + R[1, 2] * cA[2] + p[1] - cB[1]
    d2 = R[2, 0] * cA[0] + R[2, 1] * cA[1] + R[2, 2] * cA[2] + p[2] - cB[2]
    world = 0.0
    g = abs(d0) - hB[0] - (abs(R[0, 0]) * hA[0] + abs(R[0, 1]) * hA[1] + abs(R[0, 2]) * hA[2])
    if g > 0.0:
        world += g * g
    g = abs(d1) - hB[1] - (abs(R[1, 0]) * hA[0] + abs(R[1, 1]) * hA[1] + abs(R[1, 2]) * hA[2])
    if g > 0.0:
        world += g * g
    g = abs(d2) - hB[2] - (abs(R[2, 0]) * hA[0] + abs(R[2, 1]) * hA[1] + abs(R[2, 2]) * hA[2])
    if g > 0.0:
        world += g * g
    own = 0.0
    for x in range(3):
        along = R[0, x] * d0 + R[1, x] * d1 + R[2, x] * d2
        g = abs(along) - hA[x] - (abs(R[0, x]) * hB[0] + abs(R[1, x]) * hB[1] + abs(R[2, x]) * hB[2])
        if g > 0.0:
            own += g * g
    return np.sqrt(max(world, own))


@njit(cache=True, error_model="numpy", nogil=True)
def _largest(required, extra):
    best = -np.inf
    for j in range(required.shape[0]):
        best = max(best, required[j] + extra[j])
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def _blocking_at(R, p, shapes, trees, required, extra, need, deadline, scratch):
    """Index of an obstacle shape that is nearer than required + extra to the body in the frame (R, p), -1, or
    TIMED_OUT.

    ``need`` is the largest of required + extra.
    """
    VA, sA, radA, cA, bA, VB, sB, radB, lower, upper = shapes
    a, b = trees
    stack, gjk, eye, zero = scratch[0], scratch[5], scratch[8], scratch[9]
    if a.item.shape[0] == 0 or b.item.shape[0] == 0:
        return -1
    stack[0, 0], stack[0, 1] = 0, 0
    top, visits = 1, 0
    while top > 0:
        top -= 1
        visits += 1
        if visits % LOOK == 0 and now() >= deadline:
            return TIMED_OUT
        m, n = stack[top, 0], stack[top, 1]
        gap = _gap(a.center[m], a.half[m], R, p, b.center[n], b.half[n])
        if gap > 0.0 and gap >= need:
            continue
        i, j = a.item[m], b.item[n]
        if i >= 0 and j >= 0:
            wanted = required[j] + extra[j]
            if gap > 0.0 and gap >= wanted:
                continue
            d = pair_distance(
                VA[sA[i] : sA[i + 1]], R, p, radA[i], VB[sB[j] : sB[j + 1]], eye, zero, radB[j], max(wanted, 0.0), gjk
            )
            if d < wanted:
                return j
        elif j >= 0 or (i < 0 and a.radius[m] >= b.radius[n]):
            stack[top, 0], stack[top, 1] = a.second[m], n
            stack[top + 1, 0], stack[top + 1, 1] = m + 1, n
            top += 2
        else:
            stack[top, 0], stack[top, 1] = m, b.second[n]
            stack[top + 1, 0], stack[top + 1, 1] = m, n + 1
            top += 2
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def blocking(T, shapes, trees, required, extra, deadline, scratch):
    """Index of an obstacle shape nearer than required + extra (SB,) to the body at pose T (7,), -1, or TIMED_OUT."""
    R, p = scratch[6], scratch[7]
    rotation(T[3:], R)
    p[:] = T[:3]
    return _blocking_at(R, p, shapes, trees, required, extra, _largest(required, extra), deadline, scratch)


@njit(cache=True, error_model="numpy", nogil=True)
def distances(T, shapes, trees, cap, out, deadline, scratch):
    """Signed distances of the body at pose T (7,) to all obstacle shapes, into ``out`` (SB,), at most ``cap``.

    Returns:
        False if the deadline came first; ``out`` is then no bound.
    """
    VA, sA, radA, cA, bA, VB, sB, radB, lower, upper = shapes
    a, b = trees
    stack, gjk, R, p, eye, zero = scratch[0], scratch[5], scratch[6], scratch[7], scratch[8], scratch[9]
    out[:] = cap
    if a.item.shape[0] == 0 or b.item.shape[0] == 0:
        return True
    rotation(T[3:], R)
    p[:] = T[:3]
    visits = 0
    for n in range(b.item.shape[0]):
        j = b.item[n]
        if j < 0:
            continue
        stack[0, 0] = 0
        top = 1
        while top > 0:
            top -= 1
            visits += 1
            if visits % LOOK == 0 and now() >= deadline:
                return False
            m = stack[top, 0]
            gap = _gap(a.center[m], a.half[m], R, p, b.center[n], b.half[n])
            if gap > 0.0 and gap >= out[j]:
                continue
            i = a.item[m]
            if i >= 0:
                d = pair_distance(
                    VA[sA[i] : sA[i + 1]], R, p, radA[i], VB[sB[j] : sB[j + 1]], eye, zero, radB[j], max(out[j], 0.0),
                    gjk,
                )  # fmt: skip
                out[j] = min(out[j], d)
                continue
            first, second = m + 1, a.second[m]
            if _gap(a.center[second], a.half[second], R, p, b.center[n], b.half[n]) < _gap(
                a.center[first], a.half[first], R, p, b.center[n], b.half[n]
            ):
                first, second = second, first
            stack[top, 0], stack[top + 1, 0] = second, first
            top += 2
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest(R, p, shapes, trees, counted, best, deadline, scratch):
    """The smallest distance of the body in the frame (R, p) to the obstacle shapes ``counted``, at most ``best``."""
    VA, sA, radA, cA, bA, VB, sB, radB, lower, upper = shapes
    a, b = trees
    stack, gjk, eye, zero = scratch[0], scratch[5], scratch[8], scratch[9]
    stack[0, 0], stack[0, 1] = 0, 0
    top, visits = 1, 0
    while top > 0:
        top -= 1
        visits += 1
        if visits % LOOK == 0 and now() >= deadline:
            return -FAR
        m, n = stack[top, 0], stack[top, 1]
        gap = _gap(a.center[m], a.half[m], R, p, b.center[n], b.half[n])
        if gap > 0.0 and gap >= best:
            continue
        i, j = a.item[m], b.item[n]
        if i >= 0 and j >= 0:
            if counted[j]:
                d = pair_distance(
                    VA[sA[i] : sA[i + 1]], R, p, radA[i], VB[sB[j] : sB[j + 1]], eye, zero, radB[j], max(best, 0.0), gjk
                )
                best = min(best, d)
            continue
        m1, n1, m2, n2 = m, n, m, n
        if j >= 0 or (i < 0 and a.radius[m] >= b.radius[n]):
            m1, m2 = m + 1, a.second[m]
        else:
            n1, n2 = n + 1, b.second[n]
        if _gap(a.center[m2], a.half[m2], R, p, b.center[n2], b.half[n2]) < _gap(
            a.center[m1], a.half[m1], R, p, b.center[n1], b.half[n1]
        ):
            m1, n1, m2, n2 = m2, n2, m1, n1
        stack[top, 0], stack[top, 1] = m2, n2
        stack[top + 1, 0], stack[top + 1, 1] = m1, n1
        top += 2
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def clearances(poses, shapes, trees, counted, cap, least, deadline, scratch):
    """Smallest distance (M,) at the poses (M, 7) to the obstacle shapes ``counted`` (SB,), at most ``cap``.

    After the deadline it is ``least``, which is known to be kept.
    """
    R, p = scratch[6], scratch[7]
    out = np.full(poses.shape[0], cap)
    if trees[0].item.shape[0] == 0 or trees[1].item.shape[0] == 0:
        return out
    for m in range(poses.shape[0]):
        rotation(poses[m, 3:], R)
        p[:] = poses[m, :3]
        d = _nearest(R, p, shapes, trees, counted, cap, deadline, scratch)
        out[m] = least if d == -FAR else d
    return out


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _frame_at(t, R0, p0, dp, axis, angle, R, p):
    turned(R0, axis, t * angle, R)
    for k in range(3):
        p[k] = p0[k] + t * dp[k]


@njit(cache=True, error_model="numpy", nogil=True)
def _sampled(motion, span, exact, shapes, trees, required, extra, need, hit, deadline, scratch):
    """Check poses along a motion. Returns the parameter of a blocked one, the first if ``exact``, or 1 and ``hit[0]``
    -1.

    ``span`` bounds how far any point of the body moves, m.
    """
    R0, p0, dp, axis, angle = motion
    R, p = scratch[6], scratch[7]
    levels = 0
    while levels < SAMPLE_LEVELS and span > SAMPLE_STEP * 2**levels:
        levels += 1
    if exact:
        count = 2**levels
        for k in range(count + 1):
            _frame_at(k / count, R0, p0, dp, axis, angle, R, p)
            hit[0] = _blocking_at(R, p, shapes, trees, required, extra, need, deadline, scratch)
            if hit[0] != -1:
                return k / count
        return 1.0
    step = 1.0
    for level in range(levels + 1):  # 1, then 1/2, then 1/4 and 3/4, ...
        t = step if level else 1.0
        while t <= 1.0:
            _frame_at(t, R0, p0, dp, axis, angle, R, p)
            hit[0] = _blocking_at(R, p, shapes, trees, required, extra, need, deadline, scratch)
            if hit[0] != -1:
                return t
            t += 2.0 * step
        step *= 0.5
    return 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def _swept(motion, last, exact, shapes, trees, required, extra, need, hit, hits, deadline, scratch):
    """Check a motion up to the parameter ``last`` for all pairs.

    ``hits`` (SB,) receives all obstacle shapes that are hit; if it is empty, the check ends at the first one it finds,
    or, if ``exact``, with the first in time. Returns as ``free_until``, with ``last`` for a free motion; TIMED_OUT as
    ``hit[0]`` at the deadline.
    """
    VA, sA, radA, cA, bA, VB, sB, radB, lower, upper = shapes
    a, b = trees
    stack, turns, places, known, times, gjk, R, p, eye, zero = scratch
    R0, p0, dp, axis, angle = motion
    length = np.sqrt(dp[0] ** 2 + dp[1] ** 2 + dp[2] ** 2)
    along0 = R0[0, 0] * axis[0] + R0[1, 0] * axis[1] + R0[2, 0] * axis[2]  # the axis in the body's frame
    along1 = R0[0, 1] * axis[0] + R0[1, 1] * axis[1] + R0[2, 1] * axis[2]
    along2 = R0[0, 2] * axis[0] + R0[1, 2] * axis[1] + R0[2, 2] * axis[2]
    known[:] = False
    collect = hits.shape[0] > 0
    best = last
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, 1
    top, visits = 1, 0
    while top > 0:
        top -= 1
        visits += 1
        if visits % LOOK == 0 and now() >= deadline:
            hit[0] = TIMED_OUT
            return 0.0
        m, n, k = stack[top, 0], stack[top, 1], stack[top, 2]
        level = 0
        while k >> (level + 1) > 0:
            level += 1
        width = last / (1 << level)
        begin = (k - (1 << level)) * width
        if begin >= best:
            continue
        if not known[k]:
            known[k] = True
            _frame_at(begin + 0.5 * width, R0, p0, dp, axis, angle, turns[k], places[k])
        c = a.center[m]
        along = c[0] * along0 + c[1] * along1 + c[2] * along2
        arm = np.sqrt(max(c[0] ** 2 + c[1] ** 2 + c[2] ** 2 - along * along, 0.0)) + a.radius[m]
        reach = 0.5 * width * (length + angle * arm)
        gap = _gap(c, a.half[m], turns[k], places[k], b.center[n], b.half[n])
        if gap > 0.0 and gap >= need + reach:
            continue
        i, j = a.item[m], b.item[n]
        if j >= 0 and collect and hits[j]:
            continue
        if level < LEVELS and reach > max(a.radius[m], b.radius[n]) and reach > RESOLUTION:
            stack[top, 0], stack[top, 1], stack[top, 2] = m, n, 2 * k + 1
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = m, n, 2 * k
            top += 2
        elif i >= 0 and j >= 0:
            wanted = required[j] + extra[j]
            if gap > 0.0 and gap >= wanted + reach:
                continue
            V = VA[sA[i] : sA[i + 1]]
            end = min(begin + width, 1.0)
            t = pair_free(
                V, radA[i], R0, p0, dp, axis, angle, farthest(V, R0, axis), VB[sB[j] : sB[j + 1]], radB[j], wanted,
                eye, zero, R, p, gjk, times, exact, begin, end,
            )  # fmt: skip
            if t < best or t < end:
                hit[0] = j
                if collect:
                    hits[j] = True
                elif not exact:
                    return 0.0
                else:
                    best = min(best, t)
        elif j >= 0 or (i < 0 and a.radius[m] >= b.radius[n]):
            stack[top, 0], stack[top, 1], stack[top, 2] = a.second[m], n, k
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = m + 1, n, k
            top += 2
        else:
            stack[top, 0], stack[top, 1], stack[top, 2] = m, b.second[n], k
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = m, n + 1, k
            top += 2
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def _motion(T0, T1):
    axis, R0 = np.empty(3), np.empty((3, 3))
    angle = screw(T0, T1, axis)
    rotation(T0[3:], R0)
    p0 = T0[:3].copy()
    return R0, p0, T1[:3] - p0, axis, angle


@njit(cache=True, error_model="numpy", nogil=True)
def free_until(T0, T1, shapes, trees, required, extra, hit, deadline, scratch):
    """As :func:`kernels.free_until`; 0 with TIMED_OUT in ``hit[0]`` if the deadline comes first."""
    hit[0] = -1
    if trees[0].item.shape[0] == 0 or trees[1].item.shape[0] == 0:
        return 1.0
    exact = hit[1] != 0
    motion = _motion(T0, T1)
    dp, angle = motion[2], motion[4]
    root = trees[0].center[0]
    arm = np.sqrt(root[0] ** 2 + root[1] ** 2 + root[2] ** 2) + trees[0].radius[0]
    span = np.sqrt(dp[0] ** 2 + dp[1] ** 2 + dp[2] ** 2) + angle * arm
    need = _largest(required, extra)
    last = _sampled(motion, span, exact, shapes, trees, required, extra, need, hit, deadline, scratch)
    if hit[0] != -1 and (not exact or hit[0] == TIMED_OUT or last == 0.0):
        return 0.0
    none = np.zeros(0, np.bool_)
    return _swept(motion, last, exact, shapes, trees, required, extra, need, hit, none, deadline, scratch)


@njit(cache=True, error_model="numpy", nogil=True)
def hits_along(T0, T1, shapes, trees, required, extra, hits, deadline, scratch):
    """Mark in ``hits`` (SB,) all obstacle shapes that come nearer than required + extra on the motion from T0 to T1.

    Returns:
        False if the deadline came first; some may then be missing.
    """
    if trees[0].item.shape[0] == 0 or trees[1].item.shape[0] == 0:
        return True
    hit = np.array([-1, 0])
    need = _largest(required, extra)
    _swept(_motion(T0, T1), 1.0, False, shapes, trees, required, extra, need, hit, hits, deadline, scratch)
    return hit[0] != TIMED_OUT
