"""A proof that a body has no path at all: the obstacles separate start and goal for a ball inside the body.

The ball moves with the body however the body turns, so its centre needs a path in space. A cell of a grid is closed if
the ball would penetrate an obstacle too deeply at every position in the cell. If the cells that are not closed connect
one end neither with the other one nor with the border of the grid, no path exists (approximate cell decomposition:
Latombe, *Robot Motion Planning*, 1991, chapter 6).
"""

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.spatial import ConvexHull, QhullError

from hmap_core import clock
from hmap_core.collision.convex import ConvexSet
from hmap_core.transforms import IDENTITY, apply
from hmap_core.waypoints import kernels
from hmap_core.waypoints.checker import PENETRATION_ALLOWED, ObstacleShapes
from hmap_core.waypoints.enclosure_kernels import ARRIVED, ENCLOSED, flood

GRIDS = ((0.005, 128), (0.0025, 160))  # edge of a cell in m, and cells along each side: first try, second try
MAX_CELLS = 200_000  # cells that one search visits at most
OUTER = 0.5 * float(np.sqrt(3.0))  # of a cell's edge: no position in a cell is farther from its middle
SLACK = 1e-4  # m by which the ball's radius is reduced for rounding errors
SAME_RADIUS = 1e-6  # m
BISECTIONS = 6  # for the width of the widest way
GRADIENT_STEP = 5e-4  # m
WALLS_NAMED = 6  # bodies that are named if they leave no way at all
_POINT = (np.zeros((1, 3)), np.array([0, 1]), np.zeros(1), np.zeros((1, 3)), np.zeros(1))  # arrays of a body


@dataclass(frozen=True)
class Enclosure:
    """The proof, in numbers.

    Attributes:
        body: name of the body.
        ball: m, diameter of a ball inside the body.
        widest: m, diameter of the largest ball that gets from start to goal, to about a millimetre; 0 if none does;
            None if there was no time to find it.
        between: names of the bodies that bound its way where it is narrowest; without a way, those that are nearest to
            the enclosed end.
    """

    body: str
    ball: float
    widest: float | None
    between: tuple[str, ...]

    def __str__(self) -> str:
        names = " and ".join(f"'{name}'" for name in self.between)
        thick = f"'{self.body}' is {1e3 * self.ball:.0f} mm thick where it is thinnest"
        help = "list bodies that may be moved under `removable`"
        if self.widest is None:
            return f"{names} leave no gap that is wide enough; {help}, or widen the gap: {thick}"
        if self.widest <= 0.0:
            return f"{names} leave no gap; {help}, or leave a gap: {thick}"
        where = f"between {names}" if len(self.between) > 1 else f"past {names}"
        return f"the widest gap is about {1e3 * self.widest:.0f} mm wide, {where}, and {thick}; widen it, or {help}"


def enclosure(
    name: str,
    body: ConvexSet,
    obstacles: ObstacleShapes,
    T_start: np.ndarray,
    T_goal: np.ndarray,
    deadline: float = np.inf,
) -> Enclosure | None:
    """Look for the proof that no motion leads from one pose of a body to another one.

    Args:
        name: of the body, for people.
        body: the shapes of the body, in its frame.
        obstacles: everything around that does not move.
        T_start: (7,) T_world_body, free.
        T_goal: (7,) T_world_body, free.
        deadline: when the search ends, in seconds of ``clock.now``.

    Returns:
        The proof; None if the method does not decide in time, or if there may be a path.
    """
    centre, radius = inner_ball(body)
    least = radius - PENETRATION_ALLOWED - SLACK
    if least <= 0.0 or not obstacles.hulls:
        return None
    start, goal = (apply(T, centre) for T in (T_start, T_goal))
    for cell, size in GRIDS:
        for here, there in ((start, goal), (goal, start)):
            if clock.now() >= deadline:
                return None
            if _Grid(obstacles, here, there, least, cell, size, deadline).lead(least, OUTER * cell) == ENCLOSED:
                fine = _Grid(obstacles, here, there, least, *GRIDS[-1], deadline)
                return Enclosure(name, 2.0 * radius, *_widest(fine, least))
    return None


def inner_ball(body: ConvexSet) -> tuple[np.ndarray, float]:
    """Centre (3,) in the body frame and radius, m, of the largest ball inside one of the shapes of a body."""
    best, middle = 0.0, np.zeros(3)
    thickness = [float(np.ptp(body.hull(k), axis=0).min()) for k in range(len(body))]
    largest = 0.5 * np.array(thickness) + body.radius
    for k in np.argsort(-largest, kind="stable"):
        if largest[k] <= best:
            break
        centre, radius = _chebyshev(body.hull(k), best - float(body.radius[k]))
        if radius + body.radius[k] > best:
            best, middle = radius + float(body.radius[k]), centre
    return middle, best


def _chebyshev(hull: np.ndarray, above: float) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the largest ball inside the hull of points (n, 3); radius 0 for flat hulls.

    A smaller ball may be returned where none is larger than ``above`` (m).
    """
    try:
        planes = ConvexHull(hull).equations
    except (QhullError, ValueError):
        return hull.mean(axis=0), 0.0
    centre = hull.mean(axis=0)  # of several balls the middle one
    radius = float(-(planes[:, :3] @ centre + planes[:, 3]).max())
    width = float(-(hull @ planes[:, :3].T + planes[:, 3]).min(axis=0).max())  # no ball is thicker
    if 0.5 * width <= max(radius + SAME_RADIUS, above):
        return centre, radius
    A = np.column_stack([planes[:, :3], np.ones(len(planes))])
    bounds = [(None, None)] * 3 + [(0.0, None)]
    found = scipy.optimize.linprog([0.0, 0.0, 0.0, -1.0], A_ub=A, b_ub=-planes[:, 3], bounds=bounds, method="highs")
    if found.success and found.x[3] > radius + SAME_RADIUS:
        return found.x[:3], float(found.x[3])
    return centre, radius


def _widest(grid: "_Grid", least: float) -> tuple[float | None, tuple[str, ...]]:
    """Diameter in m of the widest way out of the enclosed end, and the bodies that bound it where it is narrowest.

    After the deadline the diameter is None, and the bodies are those that are nearest to the enclosed end.
    """
    low, high, way = 0.0, least, None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        result = grid.lead(middle, 0.0)
        if grid.late:
            return None, grid.nearest(grid.start, WALLS_NAMED)
        if result == ARRIVED:
            low, way = middle, grid.way()
        else:
            high = middle
    if way is None:
        return 0.0, grid.nearest(grid.start, WALLS_NAMED)
    return low + high + 0.5 * grid.cell, grid.gap(way)  # the middle of the gap is half a cell off at most


class _Grid:
    """Cells round one end, with the clearances that are known.

    Args:
        obstacles: everything around.
        start, goal: (3,) positions of the ball's centre, m.
        largest: m, the largest radius that is asked for.
        cell: edge of a cell, m.
        size: number of cells along each side.
        deadline: when searches end, in seconds of ``clock.now``.
    """

    def __init__(self, obstacles: ObstacleShapes, start, goal, largest: float, cell: float, size: int, deadline: float):
        self._deadline = deadline
        self.start = start
        self._obstacles, self.cell = obstacles, cell
        self._cap = largest + cell
        self._first = np.full(3, size // 2)
        self._origin = start - cell * self._first
        self._goal = np.round((goal - self._origin) / cell).astype(np.int64)
        self._free = np.full((size,) * 3, np.nan, np.float32)
        self._came = np.zeros((size,) * 3, np.int8)
        self._last = self._first

    @property
    def late(self) -> bool:
        """Whether the deadline is over."""
        return clock.now() >= self._deadline

    def lead(self, radius: float, slack: float) -> int:
        """Lead a ball of a radius in m from the start to the goal or to the border: what ``flood`` says of it."""
        self._came[:] = 0
        grid = self.cell, self._origin, self._first, self._goal, self._free, self._came
        result, self._last = flood(radius, slack, *grid, MAX_CELLS, self._obstacles.arrays, self._cap, self._deadline)
        return result

    def way(self) -> np.ndarray:
        """The way (n, 3) that was found last, m."""
        at, cells = self._last.copy(), [self._last.copy()]
        while not np.array_equal(at, self._first):
            side = int(self._came[tuple(at)]) - 1
            at[side // 2] -= 2 * (side % 2) - 1
            cells.append(at.copy())
        return self._origin + self.cell * np.array(cells)

    def nearest(self, point: np.ndarray, most: int) -> tuple[str, ...]:
        """Names of the bodies that are nearest to a point (3,), in the order of their distances."""
        order = np.argsort(self._distances(point), kind="stable")
        return tuple(dict.fromkeys(self._obstacles.owner[k] for k in order))[:most]

    def gap(self, way: np.ndarray) -> tuple[str, ...]:
        """Names of the one or two bodies between which a way (n, 3) is narrowest."""
        distances = np.array([self._distances(point) for point in way])
        free = distances.min(axis=1)
        pairs = [self._opposite(way[k], distances[k]) for k in np.flatnonzero(free <= free.min() + self.cell)]
        return min(pairs)[1]

    def _opposite(self, point: np.ndarray, distances: np.ndarray) -> tuple[float, tuple[str, ...]]:
        """How opposite (from 1 to -1) the nearest body and another near one are at a point (3,), and their names."""
        steps = GRADIENT_STEP * np.eye(3)
        away = np.array([self._distances(point + step) - self._distances(point - step) for step in steps])
        away /= np.maximum(np.linalg.norm(away, axis=0), GRADIENT_STEP)  # (3, SB) unit vectors away from the bodies
        first = int(distances.argmin())
        near = np.flatnonzero(distances <= distances[first] + 2.0 * self.cell)
        along = away[:, first] @ away[:, near]
        pair = (self._obstacles.owner[k] for k in (first, int(near[along.argmin()])))
        return float(along.min()), tuple(dict.fromkeys(pair))

    def _distances(self, point: np.ndarray) -> np.ndarray:
        out = np.empty(len(self._obstacles.radius))
        kernels.distances(np.array([*point, *IDENTITY[3:]]), *_POINT, *self._obstacles.arrays, np.inf, out)
        return out
