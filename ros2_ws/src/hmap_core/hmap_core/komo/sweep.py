"""The straight way from one configuration to the next, compiled: how near pairs come, and what constraints are left.

Around a configuration every point of a link moves as x(a) = x + a v + a^2/2 w + r(a), |r(a)| <= |a|^3/6 j. So two
shapes that are d apart stay as far apart along their normal as d less what these terms can take off, in a whole piece
of the way at once; a piece for which that is not enough is halved (conservative advancement [1], by halves).

[1] Mirtich, Impulse-based dynamic simulation, 1996.
"""

from collections import namedtuple

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import INLINE, OPTIONS, PLAIN
from hmap_core.collision.pairs import move_on, pair_distance, place_centers
from hmap_core.collision.simplex import WORK
from hmap_core.kinematics.tree import forward
from hmap_core.komo.arrays import EQ, INEQ
from hmap_core.komo.features.base import MAX_DIM, call_kernel

PIECES = 64  # of one interval that wait to be looked at: each halving adds one
# Motion of the frames along the way, whose length is 1: angular velocity and its derivative, velocity and acceleration
# of the origin (n + 1, 3), and bounds on the second and third derivative of any point of the frame's link (n + 1,).
Motion = namedtuple("Motion", "spin spin_rate velocity acceleration second third")


@nb.njit(**PLAIN)
def derive(chain, dq, R, p, motion):
    """Writes the motion of the frames (R, p) along dq (n,)."""
    spin, rate, velocity, acceleration = motion.spin, motion.spin_rate, motion.velocity, motion.acceleration
    turn, second, third = 0.0, 0.0, 0.0
    for k in range(dq.shape[0]):
        a, f = chain.parent[k], k + 1
        if chain.first[f] == k:
            turn, second, third = 0.0, 0.0, 0.0
        r0, r1, r2 = p[f, 0] - p[a, 0], p[f, 1] - p[a, 1], p[f, 2] - p[a, 2]
        w0, w1, w2 = spin[a, 0], spin[a, 1], spin[a, 2]
        u0, u1, u2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
        e0, e1, e2 = rate[a, 0], rate[a, 1], rate[a, 2]
        z0, z1, z2 = R[f, 0, 2] * dq[k], R[f, 1, 2] * dq[k], R[f, 2, 2] * dq[k]
        g0, g1, g2 = w1 * z2 - w2 * z1, w2 * z0 - w0 * z2, w0 * z1 - w1 * z0
        velocity[f, 0], velocity[f, 1], velocity[f, 2] = velocity[a, 0] + u0, velocity[a, 1] + u1, velocity[a, 2] + u2
        acceleration[f, 0] = acceleration[a, 0] + e1 * r2 - e2 * r1 + w1 * u2 - w2 * u1
        acceleration[f, 1] = acceleration[a, 1] + e2 * r0 - e0 * r2 + w2 * u0 - w0 * u2
        acceleration[f, 2] = acceleration[a, 2] + e0 * r1 - e1 * r0 + w0 * u1 - w1 * u0
        size, reach = abs(dq[k]), chain.reach[k]
        if chain.prismatic[k] == 1:
            velocity[f, 0] += z0
            velocity[f, 1] += z1
            velocity[f, 2] += z2
            acceleration[f, 0] += 2.0 * g0
            acceleration[f, 1] += 2.0 * g1
            acceleration[f, 2] += 2.0 * g2
            spin[f, 0], spin[f, 1], spin[f, 2] = w0, w1, w2
            rate[f, 0], rate[f, 1], rate[f, 2] = e0, e1, e2
            second += 2.0 * reach * size * turn
            third += 3.0 * reach * size * turn * turn
        else:
            spin[f, 0], spin[f, 1], spin[f, 2] = w0 + z0, w1 + z1, w2 + z2
            rate[f, 0], rate[f, 1], rate[f, 2] = e0 + g0, e1 + g1, e2 + g2
            # the derivative by several joints is as long as the point's arm about the last of them, at most
            more = turn + size
            second += reach * (more * more - turn * turn)
            third += reach * (more * more * more - turn * turn * turn)
            turn = more
        motion.second[f], motion.third[f] = second, third


@nb.njit(**INLINE)
def travel_bound(cols, s, half, p, centers, motion):
    """How far any point of the shape s may move within ``half`` of the way to either side, m."""
    f = cols.frame[s]
    if f == 0:
        return 0.0
    r0, r1, r2 = centers[s, 0] - p[f, 0], centers[s, 1] - p[f, 1], centers[s, 2] - p[f, 2]
    w0, w1, w2 = motion.spin[f, 0], motion.spin[f, 1], motion.spin[f, 2]
    v0 = motion.velocity[f, 0] + w1 * r2 - w2 * r1
    v1 = motion.velocity[f, 1] + w2 * r0 - w0 * r2
    v2 = motion.velocity[f, 2] + w0 * r1 - w1 * r0
    speed = np.sqrt(v0 * v0 + v1 * v1 + v2 * v2) + cols.bound[s] * np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    return half * (speed + 0.5 * half * motion.second[f] * cols.speed[s])


@nb.njit(**PLAIN)
def approach_bound(cols, k, half, p, centers, motion, witness):
    """By how much the shapes of pair k may come nearer along their normal within ``half`` of the way, m."""
    n0, n1, n2 = witness[0, 0], witness[0, 1], witness[0, 2]
    speed, rate, turning, jerk = 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        s = cols.a[k] if side == 0 else cols.b[k]
        f = cols.frame[s]
        if f == 0:
            continue
        sign = -1.0 if side == 0 else 1.0
        r0, r1, r2 = centers[s, 0] - p[f, 0], centers[s, 1] - p[f, 1], centers[s, 2] - p[f, 2]
        w0, w1, w2 = motion.spin[f, 0], motion.spin[f, 1], motion.spin[f, 2]
        e0, e1, e2 = motion.spin_rate[f, 0], motion.spin_rate[f, 1], motion.spin_rate[f, 2]
        u0, u1, u2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
        speed += sign * (
            n0 * (motion.velocity[f, 0] + u0) + n1 * (motion.velocity[f, 1] + u1) + n2 * (motion.velocity[f, 2] + u2)
        )
        rate += sign * (
            n0 * (motion.acceleration[f, 0] + e1 * r2 - e2 * r1 + w1 * u2 - w2 * u1)
            + n1 * (motion.acceleration[f, 1] + e2 * r0 - e0 * r2 + w2 * u0 - w0 * u2)
            + n2 * (motion.acceleration[f, 2] + e0 * r1 - e1 * r0 + w0 * u1 - w1 * u0)
        )
        # points beside the centre: what turns about the normal, or slides along the plane, comes no nearer
        along, square = w0 * n0 + w1 * n1 + w2 * n2, w0 * w0 + w1 * w1 + w2 * w2
        c0, c1, c2 = w1 * n2 - w2 * n1, w2 * n0 - w0 * n2, w0 * n1 - w1 * n0
        turning += cols.bound[s] * np.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        d0, d1, d2 = e1 * n2 - e2 * n1, e2 * n0 - e0 * n2, e0 * n1 - e1 * n0
        g0, g1, g2 = w0 * along - n0 * square, w1 * along - n1 * square, w2 * along - n2 * square
        rate += cols.bound[s] * (np.sqrt(d0 * d0 + d1 * d1 + d2 * d2) + np.sqrt(g0 * g0 + g1 * g1 + g2 * g2))
        jerk += motion.third[f] * cols.speed[s]
    return half * (abs(speed) + turning + half * (0.5 * max(0.0, rate) + half * jerk / 6.0))


@nb.njit(**PLAIN)
def halve(path, t, dq, k, chain, cols, resolution, q, R, p, centers, motion, pieces, guess, witness, work):
    """Looks closer at pair k in the interval t; returns (its worst violation in m, where in the interval)."""
    min_distance, a, b = cols.min_distance[k], cols.a[k], cols.b[k]
    worst, where = 0.0, 0.0
    pieces[0, 0], pieces[0, 1], pieces[1, 0], pieces[1, 1] = 0.5, 1.0, 0.0, 0.5
    count = 2
    while count > 0:
        count -= 1
        begin, end = pieces[count, 0], pieces[count, 1]
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        for i in range(q.shape[0]):
            q[i] = path[t, i] + middle * dq[i]
        forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        derive(chain, dq, R, p, motion)
        for side in range(2):
            s = a if side == 0 else b
            f = cols.frame[s]
            for x in range(3):
                centers[s, x] = p[f, x]
                for y in range(3):
                    centers[s, x] += R[f, x, y] * cols.center[s, y]
        travel = travel_bound(cols, a, half, p, centers, motion) + travel_bound(cols, b, half, p, centers, motion)
        slack = pair_distance(cols, k, R, p, centers, min_distance + travel, guess, witness, work) - min_distance
        if -slack > worst:
            worst, where = -slack, middle
        if slack > travel:
            continue
        approach = approach_bound(cols, k, half, p, centers, motion, witness)
        if approach > max(slack, resolution) and count + 2 <= pieces.shape[0]:
            pieces[count, 0], pieces[count, 1] = middle, end
            pieces[count + 1, 0], pieces[count + 1, 1] = begin, middle
            count += 2
    return worst, where


@nb.njit(**PLAIN)
def _intervals(
    path, masks, chain, cols, resolution, violation, pair, where, dq, q, R, p, R_own, p_own, turned, centers, own,
    moved, travel, slack, motion, motion_own, pieces, guesses, witness, work,
):  # fmt: skip
    """:func:`between_violations` with room for everything."""
    half = 0.5
    for t in range(masks.shape[0]):
        for i in range(dq.shape[0]):
            dq[i] = path[t + 1, i] - path[t, i]
            q[i] = path[t, i] + half * dq[i]
        forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
        derive(chain, dq, R, p, motion)
        if t == 0:
            place_centers(cols, R, p, centers)
        move_on(cols, R, p, centers, turned, moved, slack)
        for s in range(travel.shape[0]):
            travel[s] = travel_bound(cols, s, half, p, centers, motion)
        for k in range(slack.shape[0]):
            moves = travel[cols.a[k]] + travel[cols.b[k]]
            if slack[k] > moves or cols.phases[k] & masks[t] == 0:
                continue
            d = pair_distance(cols, k, R, p, centers, cols.min_distance[k] + moves, guesses[k], witness, work)
            slack[k] = d - cols.min_distance[k]
            if -slack[k] > violation[t]:
                violation[t], pair[t], where[t] = -slack[k], k, half
            if slack[k] > moves or not approach_bound(cols, k, half, p, centers, motion, witness) > max(
                slack[k], resolution
            ):
                continue
            worst, at = halve(
                path, t, dq, k, chain, cols, resolution, q, R_own, p_own, own, motion_own, pieces, guesses[k], witness,
                work,
            )  # fmt: skip
            if worst > violation[t]:
                violation[t], pair[t], where[t] = worst, k, at


@nb.njit(**OPTIONS)
def new_motion(frames):
    """Room for the motion of some frames, zero at first."""
    return Motion(
        np.zeros((frames, 3)), np.zeros((frames, 3)), np.zeros((frames, 3)), np.zeros((frames, 3)), np.zeros(frames),
        np.zeros(frames),
    )  # fmt: skip


@nb.njit(**OPTIONS)
def between_violations(path, masks, chain, cols, resolution):
    """Worst minimum distance violation within each interval of a path that is straight between its configurations.

    Args:
        path: (T + 1, n); masks: (T,) bit mask of the phases of each interval.
        chain, cols: see :mod:`hmap_core.kinematics.chain` and :mod:`hmap_core.collision.scene_model`.
        resolution: what a pair may come nearer by between two looks without being noticed, m.

    Returns:
        (violation (T,) in metres, 0 where there is none; pair (T,) or -1; alpha (T,): where in the interval).
    """
    T, n = path.shape[0] - 1, path.shape[1]
    P, shapes = cols.a.shape[0], cols.frame.shape[0]
    violation, pair, where = np.zeros(T), np.full(T, -1, np.int64), np.zeros(T)
    _intervals(
        path, masks, chain, cols, resolution, violation, pair, where, np.zeros(n), np.zeros(n),
        np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3, 3)), np.zeros((shapes, 3)), np.zeros((shapes, 3)), np.zeros(shapes), np.zeros(shapes),
        np.zeros(P), new_motion(n + 1), new_motion(n + 1), np.zeros((PIECES, 2)), np.zeros((P, 9), np.int16),
        np.zeros((3, 3)), np.zeros(WORK),
    )  # fmt: skip
    return violation, pair, where


@nb.njit(**PLAIN)
def _left(path, chain, terms, tolerance, alphas, q, R, p, r, J, place, component, amount):
    """:func:`left_between` with room for everything."""
    n, places = q.shape[0], alphas.shape[0]
    last = -1
    for m in range(terms.step.shape[0]):
        t, dim, own = terms.step[m], terms.dim[m], terms.objective[m]
        if tolerance[own, 0] <= 0.0 or terms.type[m] > INEQ:
            continue
        if t != last:
            last = t
            for a in range(places):
                for i in range(n):
                    q[i] = path[t, i] + alphas[a] * (path[t + 1, i] - path[t, i])
                forward(q, chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R[a], p[a])
        worst = 1.0
        for a in range(places):
            for i in range(n):
                q[i] = path[t, i] + alphas[a] * (path[t + 1, i] - path[t, i])
            for d in range(dim):
                for i in range(n):
                    J[d, i] = 0.0
            call_kernel(
                terms.kernel[m], n, R[a].ctypes.data, p[a].ctypes.data, chain.first.ctypes.data,
                chain.prismatic.ctypes.data, q.ctypes.data, terms.frames[m].ctypes.data,
                terms.params[terms.offset[m] :].ctypes.data, r.ctypes.data, J.ctypes.data,
            )  # fmt: skip
            for d in range(dim):
                value = r[d] - terms.target[m, d]
                if terms.type[m] == EQ:
                    value = abs(value)
                off = value / tolerance[own, d]
                if off > worst:
                    worst = off
                    place[m], component[m], amount[m] = a, d, value
            if place[m] == 0:
                place[m] = -1  # it did not hold where the interval begins: nothing is left
                break


@nb.njit(**OPTIONS)
def left_between(path, chain, terms, tolerance, alphas):
    """Where constraints that hold at the beginning of an interval are left within it.

    Args:
        path: (T + 1, n); chain: see :mod:`hmap_core.kinematics.chain`; terms: see :mod:`hmap_core.komo.arrays`.
        tolerance: (objectives, D) by which each component may be off; 0 for objectives that are left out.
        alphas: (A,) where in the intervals they are looked at, first 0.

    Returns:
        (place (M,) of the worst, an index into ``alphas``, -1 where it is kept; component (M,); amount (M,), m or rad).
    """
    n, M, places = path.shape[1], terms.step.shape[0], alphas.shape[0]
    place, component, amount = np.full(M, -1), np.zeros(M, np.int64), np.zeros(M)
    _left(
        path, chain, terms, tolerance, alphas, np.zeros(n), np.zeros((places, n + 1, 3, 3)),
        np.zeros((places, n + 1, 3)), np.zeros(MAX_DIM), np.zeros((MAX_DIM, n)), place, component, amount,
    )  # fmt: skip
    return place, component, amount
