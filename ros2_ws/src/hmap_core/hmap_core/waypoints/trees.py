"""RRT-Connect for one body, compiled: two trees of poses grow towards samples and towards each other.

Method: Kuffner & LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", ICRA 2000. Two changes:
a blocked step is tried again without its rotation, so that a body that is aligned with a narrow passage continues along
it; and the metric of the nearest-neighbour search is cheap, because each step compares thousands of poses.
"""

import numpy as np
from numba import njit

from hmap_core.clock import now
from hmap_core.waypoints import tree_kernels
from hmap_core.waypoints.kernels import free_until, length, part_way
from hmap_core.waypoints.support import stable_along


@njit(cache=True, error_model="numpy", nogil=True)
def _sample(rng, space, T):
    """Sample a pose into ``T`` (7,), uniform in the bounds and in rotation (Shoemake 1992) or yaw."""
    level, reference, lower, upper = space[:4]
    for k in range(3):
        T[k] = lower[k] + rng.random() * (upper[k] - lower[k])
    if level:
        half = np.pi * rng.random()
        s, c = np.sin(half), np.cos(half)
        qx, qy, qz, qw = reference[3], reference[4], reference[5], reference[6]
        T[3], T[4], T[5], T[6] = c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz
        return
    u, v, w = rng.random(), 2.0 * np.pi * rng.random(), 2.0 * np.pi * rng.random()
    a, b = np.sqrt(1.0 - u), np.sqrt(u)
    T[3], T[4], T[5], T[6] = a * np.sin(v), a * np.cos(v), b * np.sin(w), b * np.cos(w)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=True)
def _nearest(nodes, count, T, radius):
    """Index of the pose of nodes[:count] nearest to T, by displacement and the rotation's chord times ``radius``."""
    best, at = np.inf, 0
    weight = 8.0 * radius * radius  # chord^2 = 4 sin^2(angle / 4) * 4 = 8 (1 - |dot|)
    for i in range(count):
        x, y, z = nodes[i, 0] - T[0], nodes[i, 1] - T[1], nodes[i, 2] - T[2]
        dot = nodes[i, 3] * T[3] + nodes[i, 4] * T[4] + nodes[i, 5] * T[5] + nodes[i, 6] * T[6]
        d = x * x + y * y + z * z + weight * (1.0 - abs(dot))
        if d < best:
            best, at = d, i
    return at


@njit(cache=True, error_model="numpy", nogil=True)
def _free(T0, T1, shapes, trees, required, extra, support, blocked, deadline, scratch, hit):
    """Whether the motion from T0 to T1 is free and supported; counts the obstacle that blocks in ``blocked`` (SB,)."""
    hit[0], hit[1] = -1, 0
    if trees[0].item.shape[0] > 0:
        free = tree_kernels.free_until(T0, T1, shapes, trees, required, extra, hit, deadline, scratch)
    else:
        VA, sA, radA, cA, bA, VB, sB, radB, lower, upper = shapes
        free = free_until(T0, T1, VA, sA, radA, cA, bA, VB, sB, radB, lower, upper, required, extra, hit)
    if free < 1.0:
        if hit[0] >= 0:
            blocked[hit[0]] += 1
        return False
    held, reference, arm, com, feet, feet_start, tops, tops_start, outline, boxes = support
    return not held or stable_along(T0, T1, reference, arm, com, feet, feet_start, tops, tops_start, outline, boxes)


@njit(cache=True, error_model="numpy", nogil=True)
def grow(nodes, parent, count, link, rng, space, shapes, trees, required, extra, support, blocked, deadline, budget):
    """Grow two trees until they meet, are full, ``budget`` motions are checked, or the deadline is over.

    Args:
        nodes: (2, N, 7) poses of both trees, the roots first.
        parent: (2, N) index of each pose's parent, -1 for roots.
        count: (3,) number of poses in each tree, and of iterations; another call continues from there.
        link: (2,) output: the nodes where the trees meet; unchanged if they do not.
        rng: numpy Generator.
        space: turns about the vertical only?, reference pose (7,) of such turns, lower (3,) and upper (3,) position in
            m, metres that a radian of rotation counts as, longest step in those metres.
        shapes: arrays of the checker; so are ``trees``, ``required``, ``extra`` and ``blocked``.
        support: whether the body needs a support, and the arrays of the support.
        deadline: in seconds of ``clock.now``.
        budget: largest number of motions.

    Returns:
        The number of checked motions.
    """
    radius, step = space[4], space[5]
    sample, new, spare = np.empty(7), np.empty(7), np.empty(7)
    hit = np.zeros(2, np.int64)
    scratch = tree_kernels.new_scratch()
    capacity = nodes.shape[1]
    used = 0
    while used < budget and max(count[0], count[1]) < capacity and now() < deadline:
        a = count[2] & 1
        b = 1 - a
        count[2] += 1
        _sample(rng, space, sample)
        i = _nearest(nodes[a], count[a], sample, radius)
        part_way(nodes[a, i], sample, min(1.0, step / length(nodes[a, i], sample, radius)), new)
        used += 1
        if not _free(nodes[a, i], new, shapes, trees, required, extra, support, blocked, deadline, scratch, hit):
            new[3:] = nodes[a, i, 3:]
            used += 1
            if not _free(nodes[a, i], new, shapes, trees, required, extra, support, blocked, deadline, scratch, hit):
                continue
        nodes[a, count[a]], parent[a, count[a]] = new, i
        count[a] += 1
        i = _nearest(nodes[b], count[b], new, radius)
        rest = length(nodes[b, i], new, radius)
        while count[b] < capacity and now() < deadline:
            last = rest <= step
            part_way(nodes[b, i], new, 1.0 if last else step / rest, spare)
            used += 1
            if not _free(nodes[b, i], spare, shapes, trees, required, extra, support, blocked, deadline, scratch, hit):
                break
            if last:
                link[a], link[b] = count[a] - 1, i
                return used
            nodes[b, count[b]], parent[b, count[b]] = spare, i
            i = count[b]
            count[b] += 1
            rest -= step
    return used
