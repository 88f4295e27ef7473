"""Compiled flood of a grid by a ball among convex shapes."""

import heapq

import numpy as np
from numba import njit

from hmap_core.clock import now
from hmap_core.waypoints.kernels import distances

ENCLOSED, ARRIVED, UNKNOWN = 0, 1, 2
LOOK = 16  # clearances between two looks at the clock


@njit(cache=True, error_model="numpy", nogil=True)
def flood(radius, slack, cell, origin, first, goal, free, came, most, shapes, cap, deadline):
    """Lead a ball from one cell of a cubic grid to another one, or to the border of the grid.

    The cells nearest to the goal are visited first.

    Args:
        radius: of the ball, m.
        slack: m; a cell is closed if the clearance of its middle is less than the radius by more than that.
        cell: edge of a cell, m.
        origin: (3,) middle of the first cell, m.
        first, goal: (3,) indices of the cells of start and goal; the goal may be outside of the grid.
        free: (n, n, n) clearance of the middles of cells, m; NaN where it is not known yet. Written.
        came: (n, n, n) from which side a cell was entered, 1 to 6; 0: not visited. All 0 at first. Written.
        most: number of cells that are visited at most.
        shapes: vertices, start, radius, lower, upper of the obstacles, as in ``ObstacleShapes.arrays``.
        cap: m, clearances are computed up to this.
        deadline: when the flood ends, in seconds of ``clock.now``.

    Returns:
        ENCLOSED, ARRIVED, or UNKNOWN after ``most`` cells or the deadline; and (3,) the last cell that was visited.
    """
    n = free.shape[0]
    VB, sB, radB, lower, upper = shapes
    point, sA, none = np.zeros((1, 3)), np.array([0, 1]), np.zeros(1)
    T, out = np.zeros(7), np.empty(radB.shape[0])
    T[6] = 1.0
    at = first.copy()
    came[at[0], at[1], at[2]] = 7
    queue = [(0.0, (at[0] * n + at[1]) * n + at[2])]
    visited, looked = 1, 0
    while len(queue) > 0:
        index = heapq.heappop(queue)[1]
        at[0], at[1], at[2] = index // (n * n), (index // n) % n, index % n
        if at[0] == goal[0] and at[1] == goal[1] and at[2] == goal[2]:
            return ARRIVED, at
        if at.min() == 0 or at.max() == n - 1:
            return ARRIVED, at
        if visited >= most:
            return UNKNOWN, at
        for side in range(6):
            i, j, k = at[0], at[1], at[2]
            step = 2 * (side % 2) - 1
            if side < 2:
                i += step
            elif side < 4:
                j += step
            else:
                k += step
            if came[i, j, k] > 0:
                continue
            room = free[i, j, k]
            if np.isnan(room):
                looked += 1
                if looked % LOOK == 0 and now() >= deadline:
                    return UNKNOWN, at
                T[0], T[1], T[2] = origin[0] + cell * i, origin[1] + cell * j, origin[2] + cell * k
                distances(T, point, sA, none, point, none, VB, sB, radB, lower, upper, cap, out)
                room = out.min()
                free[i, j, k] = room
            if room + slack < radius:
                continue
            came[i, j, k] = side + 1
            visited += 1
            away = (i - goal[0]) ** 2 + (j - goal[1]) ** 2 + (k - goal[2]) ** 2
            heapq.heappush(queue, (float(away), (i * n + j) * n + k))
    return ENCLOSED, at
