"""Compiled collision checks of one moving body against fixed convex shapes.

A motion between two poses is straight in position and turns at a constant rate about one axis through the origin of the
body frame, as in :func:`hmap_core.transforms.interpolate`. The check covers the whole motion and not only samples: the
separating direction at one instant bounds how long the pair stays apart (conservative advancement with directional
motion bounds, after Tang, Kim & Manocha, "C2A: Controlled Conservative Advancement", ICRA 2009).

Shapes are passed as arrays. Of the body: vertices VA (m, 3), start indices sA, radii radA, bounding spheres cA, bA, in
the body frame. Of the SB obstacle shapes: vertices VB (m, 3), start indices sB, radii radB, and the bounding boxes
lower, upper (SB, 3), in the world frame. Lengths are in m.
"""

import numpy as np
from numba import njit

from hmap_core.collision.convex import signed_distance
from hmap_core.collision.epa import FAR
from hmap_core.collision.gjk import distance_from
from hmap_core.collision.simplex import WORK

# an interval in which no point moves farther than this counts as one instant, m
RESOLUTION = 4e-4
# smallest closing speed that counts as motion, m per unit of the motion parameter
_TINY = 1e-12
# sine of half a rotation angle below which its square is lost in rounding
_SMALL_TURN = 1e-4
# capacity of the stack of intervals; they are halved, so the stack never has more
STACK = 128


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def rotation(q, R):
    """Rotation matrix R (3, 3) of a unit quaternion q (4,) xyzw."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    R[0, 0] = 1 - 2 * (y * y + z * z)
    R[0, 1] = 2 * (x * y - z * w)
    R[0, 2] = 2 * (x * z + y * w)
    R[1, 0] = 2 * (x * y + z * w)
    R[1, 1] = 1 - 2 * (x * x + z * z)
    R[1, 2] = 2 * (y * z - x * w)
    R[2, 0] = 2 * (x * z - y * w)
    R[2, 1] = 2 * (y * z + x * w)
    R[2, 2] = 1 - 2 * (x * x + y * y)


@njit(cache=True, error_model="numpy", nogil=True)
def screw(T0, T1, axis):
    """Rotation from pose T0 to pose T1 (7,).

    Args:
        T0: start pose.
        T1: end pose.
        axis: (3,) output: the axis in the world frame.

    Returns:
        The angle in [0, pi].
    """
    ax, ay, az, aw = T1[3], T1[4], T1[5], T1[6]
    bx, by, bz, bw = -T0[3], -T0[4], -T0[5], T0[6]
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    s = np.sqrt(x * x + y * y + z * z)
    if s < _TINY:
        axis[0], axis[1], axis[2] = 0.0, 0.0, 1.0
        return 0.0
    axis[0], axis[1], axis[2] = x / s, y / s, z / s
    return 2.0 * np.arctan2(s, w)


@njit(cache=True, error_model="numpy", nogil=True)
def length(T0, T1, radius):
    """Length of a motion in m: displacement plus rotation times ``radius``."""
    x, y, z = T1[0] - T0[0], T1[1] - T0[1], T1[2] - T0[2]
    dot = T0[3] * T1[3] + T0[4] * T1[4] + T0[5] * T1[5] + T0[6] * T1[6]
    s = np.sqrt(max(0.0, 1.0 - dot * dot))
    if s < _SMALL_TURN:  # the sine above has only half its digits here
        s = 0.0
        for k in range(3, 7):
            d = T1[k] - np.copysign(1.0, dot) * T0[k]
            s += d * d
        s = np.sqrt(s)
    return np.sqrt(x * x + y * y + z * z) + radius * 2.0 * np.arctan2(s, abs(dot))


@njit(cache=True, error_model="numpy", nogil=True)
def lengths(path, radius):
    """Lengths (n - 1,) in metres of the motions between successive poses (n, 7)."""
    out = np.empty(path.shape[0] - 1)
    for k in range(out.shape[0]):
        out[k] = length(path[k], path[k + 1], radius)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def all_lengths(poses, radius):
    """Lengths (n, n) in metres of the motions between all poses (n, 7)."""
    n = poses.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            out[i, j] = out[j, i] = length(poses[i], poses[j], radius)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def part_way(T0, T1, t, out):
    """Write the pose at the parameter t of the motion from T0 to T1 into ``out`` (7,); as transforms.interpolate."""
    axis = np.empty(3)
    angle = screw(T0, T1, axis)
    for k in range(3):
        out[k] = T0[k] + t * (T1[k] - T0[k])
    s, c = np.sin(0.5 * t * angle), np.cos(0.5 * t * angle)
    x, y, z = s * axis[0], s * axis[1], s * axis[2]
    out[3] = c * T0[3] + x * T0[6] + y * T0[5] - z * T0[4]
    out[4] = c * T0[4] - x * T0[5] + y * T0[6] + z * T0[3]
    out[5] = c * T0[5] + x * T0[4] - y * T0[3] + z * T0[6]
    out[6] = c * T0[6] - x * T0[3] - y * T0[4] - z * T0[5]


@njit(cache=True, error_model="numpy", nogil=True)
def between(T0, T1, t):
    """Poses (n, 7) at the parameters t (n,) of the motion from T0 to T1; as transforms.interpolate."""
    out = np.empty((t.shape[0], 7))
    for i in range(t.shape[0]):
        part_way(T0, T1, t[i], out[i])
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def turned(R0, axis, angle, R):
    """R (3, 3) = rotation by ``angle`` about the world ``axis``, applied after R0 (Rodrigues' formula)."""
    s, c = np.sin(angle), np.cos(angle)
    for k in range(3):
        x, y, z = R0[0, k], R0[1, k], R0[2, k]
        dot = (axis[0] * x + axis[1] * y + axis[2] * z) * (1.0 - c)
        R[0, k] = x * c + (axis[1] * z - axis[2] * y) * s + axis[0] * dot
        R[1, k] = y * c + (axis[2] * x - axis[0] * z) * s + axis[1] * dot
        R[2, k] = z * c + (axis[0] * y - axis[1] * x) * s + axis[2] * dot


@njit(cache=True, error_model="numpy", nogil=True)
def farthest(V, R0, axis):
    """Largest distance of the vertices V (n, 3) from the axis of rotation through the frame's origin."""
    best = 0.0
    a0 = R0[0, 0] * axis[0] + R0[1, 0] * axis[1] + R0[2, 0] * axis[2]
    a1 = R0[0, 1] * axis[0] + R0[1, 1] * axis[1] + R0[2, 1] * axis[2]
    a2 = R0[0, 2] * axis[0] + R0[1, 2] * axis[1] + R0[2, 2] * axis[2]
    for i in range(V.shape[0]):
        along = V[i, 0] * a0 + V[i, 1] * a1 + V[i, 2] * a2
        d = V[i, 0] ** 2 + V[i, 1] ** 2 + V[i, 2] ** 2 - along * along
        if d > best:
            best = d
    return np.sqrt(best)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _box_gap(center, radius, lower, upper):
    """Distance of a sphere from an axis-aligned box; negative if they overlap."""
    s = 0.0
    for k in range(3):
        d = max(lower[k] - center[k], center[k] - upper[k])
        if d > 0.0:
            s += d * d
    return np.sqrt(s) - radius


@njit(cache=True, error_model="numpy", nogil=True)
def distances(T, VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, cap, out):
    """Signed distances of the body at pose T (7,) to all obstacle shapes, into ``out`` (SB,), at most ``cap``."""
    R = np.empty((3, 3))
    rotation(T[3:], R)
    p = T[:3].copy()
    eye = np.eye(3)
    zero = np.zeros(3)
    witness = np.empty((3, 3))
    out[:] = cap
    for i in range(sA.shape[0] - 1):
        center = R @ cA[i] + p
        for j in range(sB.shape[0] - 1):
            if _box_gap(center, bA[i], lower[j], upper[j]) >= out[j]:
                continue
            d = signed_distance(
                VA[sA[i] : sA[i + 1]], R, p, radA[i], VB[sB[j] : sB[j + 1]], eye, zero, radB[j], witness
            )
            if d < out[j]:
                out[j] = d


@njit(cache=True, error_model="numpy", nogil=True)
def clearances(poses, VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, counted, cap):
    """Smallest distance (M,) at the poses (M, 7) to the obstacle shapes ``counted`` (SB,), at most ``cap``."""
    out = np.full(poses.shape[0], cap)
    each = np.empty(sB.shape[0] - 1)
    for m in range(poses.shape[0]):
        distances(poses[m], VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, cap, each)
        for j in range(each.shape[0]):
            if counted[j] and each[j] < out[m]:
                out[m] = each[j]
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def blocking(T, VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, required, extra):
    """Index of an obstacle shape nearer than required + extra (SB,) to the body at pose T (7,), or -1."""
    R = np.empty((3, 3))
    rotation(T[3:], R)
    p = T[:3].copy()
    eye = np.eye(3)
    zero = np.zeros(3)
    witness = np.empty((3, 3))
    for i in range(sA.shape[0] - 1):
        center = R @ cA[i] + p
        for j in range(sB.shape[0] - 1):
            need = required[j] + extra[j]
            if _box_gap(center, bA[i], lower[j], upper[j]) >= need:
                continue
            d = signed_distance(
                VA[sA[i] : sA[i + 1]], R, p, radA[i], VB[sB[j] : sB[j + 1]], eye, zero, radB[j], witness
            )
            if d < need:
                return j
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def gjk_scratch():
    """Memory of the distance queries of one pair after the other: a cached guess, no edges, numbers, and witnesses."""
    return np.zeros(9, np.int16), np.empty(0, np.int32), np.zeros(WORK), np.empty((3, 3))


@njit(cache=True, error_model="numpy", nogil=True)
def pair_distance(V, R, p, rad, W, eye, zero, radW, cutoff, scratch):
    """Signed distance (m) of one pair of shapes, or a value above ``cutoff``; the query starts from nothing."""
    guess, none, work, witness = scratch
    guess[0] = 0
    for k in range(3):
        work[k] = p[k] - zero[k]
    return distance_from(V, none, R, p, rad, W, none, eye, zero, radW, cutoff, guess, witness, work)


@njit(cache=True, error_model="numpy", nogil=True)
def pair_free(V, rad, R0, p0, dp, axis, angle, arm, W, radW, need, eye, zero, R, p, scratch, stack, exact, begin, end
):  # fmt: skip
    """Parameter in [begin, end] up to which one pair's motion is free; 1: all of it. If not ``exact``, only "less than
    1".
    """
    witness = scratch[3]
    speed = np.sqrt(dp[0] ** 2 + dp[1] ** 2 + dp[2] ** 2) + angle * arm
    top = 1
    stack[0, 0], stack[0, 1] = begin, end
    first_hit = 1.0 + _TINY
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        if a >= first_hit:
            continue
        m = 0.5 * (a + b)
        turned(R0, axis, m * angle, R)
        for k in range(3):
            p[k] = p0[k] + m * dp[k]
        slack = pair_distance(V, R, p, rad, W, eye, zero, radW, FAR, scratch) - need
        instant = (b - a) * speed <= RESOLUTION
        if slack < 0.0:
            first_hit = min(first_hit, a if instant else m)
            if not exact:
                return 0.0
            left, right = m, b
        else:
            along = dp[0] * witness[0, 0] + dp[1] * witness[0, 1] + dp[2] * witness[0, 2]
            turn = angle * arm
            left = m - slack / max(max(along, 0.0) + turn, _TINY)
            right = m + slack / max(max(-along, 0.0) + turn, _TINY)
        # the later part is checked only if the earlier one is free, so it is pushed first
        if instant:
            continue
        if right < b:
            stack[top, 0], stack[top, 1] = right, b
            top += 1
        if left > a:
            stack[top, 0], stack[top, 1] = a, left
            top += 1
    return min(first_hit, 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def free_until(T0, T1, VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, required, extra, hit):
    """Parameter in [0, 1] up to which the motion from T0 to T1 is free.

    Args:
        T0: start pose (7,).
        T1: end pose (7,).
        required: (SB,) required distances; ``extra`` (SB,) is added to them.
        hit: (2,) output and input. ``hit[0]``: index of the obstacle shape that blocks, or -1. If ``hit[1]`` is 0, the
            check stops at the first obstacle that blocks; the parameter is then only "less than 1".
    """
    axis = np.empty(3)
    angle = screw(T0, T1, axis)
    R0 = np.empty((3, 3))
    rotation(T0[3:], R0)
    p0 = T0[:3].copy()
    dp = T1[:3] - p0
    eye = np.eye(3)
    zero = np.zeros(3)
    R = np.empty((3, 3))
    p = np.empty(3)
    scratch = gjk_scratch()
    stack = np.empty((STACK + 2, 2))
    mid = np.empty((3, 3))
    turned(R0, axis, 0.5 * angle, mid)
    length = np.sqrt(dp[0] ** 2 + dp[1] ** 2 + dp[2] ** 2)
    best = 1.0
    hit[0] = -1
    for i in range(sA.shape[0] - 1):
        V = VA[sA[i] : sA[i + 1]]
        arm = farthest(V, R0, axis)
        center = mid @ cA[i] + p0 + 0.5 * dp
        reach = bA[i] + 0.5 * (length + angle * arm)
        for j in range(sB.shape[0] - 1):
            need = required[j] + extra[j]
            if _box_gap(center, reach, lower[j], upper[j]) >= need:
                continue
            t = pair_free(
                V, radA[i], R0, p0, dp, axis, angle, arm, VB[sB[j] : sB[j + 1]], radB[j], need, eye, zero, R, p,
                scratch, stack, hit[1] != 0, 0.0, 1.0,
            )  # fmt: skip
            if t < best:
                best = t
                hit[0] = j
                if hit[1] == 0:
                    return best
    return best
