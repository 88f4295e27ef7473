"""Transits of an arm by a planner of OMPL instead of hmap's own trees: the same checks, shortening and smoothing."""

import time
from functools import partial

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.planner.hand_moves import HandMoves
from hmap_core.planner.transit import CHECKS, TransitChecks, find_transit
from hmap_core.waypoints.ompl_solver import Query, Space, box_bounds, known_planner, modules, seeded


class OmplTransit:
    """Implements :class:`hmap_core.planner.protocols.TransitPlanner` by a planner of OMPL.

    Args:
        name: class name of a geometric planner of OMPL, such as RRTConnect.

    Raises:
        InputError: OMPL is not installed, or has no such planner.
    """

    def __init__(self, name: str = ""):
        self._name = known_planner(name)

    def find_transit(
        self,
        moves: HandMoves,
        chain: Chain,
        cols: Collisions,
        mask: int,
        start: np.ndarray,
        goal: np.ndarray,
        rng: np.random.Generator,
        deadline: float,
    ) -> np.ndarray | None:
        """As :func:`find_transit_ompl`."""
        return find_transit_ompl(self._name, moves, chain, cols, mask, start, goal, rng, deadline)


def find_transit_ompl(
    name: str, moves: HandMoves, chain: Chain, cols: Collisions, mask: int, start: np.ndarray, goal: np.ndarray,
    rng: np.random.Generator, deadline: float,
) -> np.ndarray | None:  # fmt: skip
    """Search a transit as :func:`find_transit` does, but by a planner of OMPL.

    Args:
        name: class name of a geometric planner of OMPL, such as RRTConnect.
        moves: moves of the hand; not used by OMPL's planners, which move the joints.
        chain: what moves.
        cols: collision pairs with their minimum distances.
        mask: bit mask of the phases that count.
        start: (n,) rad.
        goal: (n,) rad.
        rng: the only source of randomness; OMPL's seeds are drawn from it.
        deadline: ``time.monotonic()`` after which the search ends.

    Returns:
        Configurations (m, n) of a free joint path, short and smooth; None if none was found.

    Raises:
        InputError: OMPL is not installed, or has no such planner.
    """
    connect = partial(connect_by_ompl, known_planner(name))
    return find_transit(moves, chain, cols, mask, start, goal, rng, deadline, connect)


def connect_by_ompl(
    planner: str, free: TransitChecks, moves: HandMoves, start: np.ndarray, goal: np.ndarray,
    rng: np.random.Generator, deadline: float,
) -> np.ndarray | None:  # fmt: skip
    """Configurations (m, n) of a free path from start to goal (n,), straight between them, or None.

    Args:
        planner: one of ``ompl_solver.planner_names``.
        free: checks of joint motions; the search ends after CHECKS of their looks.
        moves: not used.
        start: (n,) rad.
        goal: (n,) rad.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which the search ends.
    """
    with seeded(rng):
        space = Joints(np.minimum(free.chain.lower, np.minimum(start, goal)),
                       np.maximum(free.chain.upper, np.maximum(start, goal)))  # fmt: skip
        query = Query(planner, space, _Checks(free), start, goal)
        return query.solve(CHECKS, deadline - time.monotonic())


class Joints(Space):
    """Configurations between lower and upper (n,) limits, rad."""

    def __init__(self, lower: np.ndarray, upper: np.ndarray):
        self._n = len(lower)
        space = modules().base.RealVectorStateSpace(self._n)
        space.setBounds(box_bounds(lower, upper))
        super().__init__(space)

    def read(self, state) -> np.ndarray:
        """The configuration (n,) of a state."""
        return np.array([state[k] for k in range(self._n)])

    def write(self, state, values: np.ndarray) -> None:
        """Makes a state that of a configuration (n,)."""
        for k, value in enumerate(values):
            state[k] = float(value)


class _Checks:
    """The checks of transits; a motion counts as many looks as it takes."""

    def __init__(self, free: TransitChecks):
        self._free = free

    @property
    def evaluations(self) -> int:
        """Looks so far."""
        return self._free.looks

    def state_free(self, q: np.ndarray) -> bool:
        """Whether a configuration (n,) is free."""
        return self._free.straight(q, q)

    def motion_free(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the straight motion from a to b (n,) is free, between its configurations, too."""
        return self._free.straight(a, b)

    def free_part(self, a: np.ndarray, b: np.ndarray) -> float:
        """Parameter up to which the straight motion from a to b (n,) is free."""
        line = self._free.line(a, b)
        return self._free.reached(line) / (len(line) - 1)
