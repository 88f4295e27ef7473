"""A way for the arm when optimisation alone finds none: RRTConnect in joint space, as a first guess for KOMO."""

import time

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from hmap_core.collision.scene_model import Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.solver import path_violations
from hmap_core.planner.ompl_seeding import box, seeded

RESOLUTION = 0.05  # rad between two checked configurations of an edge
RANGE = 0.8  # rad, longest extension of the tree
CHECKS = 20_000  # configurations after which the search gives up, whatever the clock says
SHORTCUTS = 60


class _Free:
    """Counts and answers collision checks of configurations in the phases of a mask."""

    def __init__(self, chain: Chain, cols: Collisions, mask: int):
        self._chain, self._cols, self._mask = chain, cols, mask
        self.checks = 0

    def path(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the straight motion from a to b (n,) is free at the resolution."""
        steps = max(1, int(np.ceil(np.abs(b - a).max() / RESOLUTION)))
        return self.configurations(a + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (b - a))

    def configurations(self, Q: np.ndarray) -> bool:
        self.checks += len(Q)
        masks = np.full(len(Q), self._mask, np.int64)
        return not (path_violations(np.ascontiguousarray(Q), masks, self._chain, self._cols, 0.0)[1] >= 0).any()


class _Motions(ob.MotionValidator):
    def __init__(self, si, free: _Free, read):
        super().__init__(si)
        self._free, self._read = free, read

    def checkMotion(self, first, second) -> bool:
        return bool(self._free.path(self._read(first), self._read(second)))


def find_transit(
    chain: Chain, cols: Collisions, mask: int, start: np.ndarray, goal: np.ndarray, rng: np.random.Generator,
    deadline: float,
) -> np.ndarray | None:  # fmt: skip
    """Corners (m, n) of a free joint path from start to goal (n,), shortened; None when none was found.

    Args:
        chain, cols, mask: what moves, what keeps apart, and the bit mask of phases that counts.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which to give up.
    """
    free = _Free(chain, cols, mask)
    with seeded(rng):
        path = _connect(free, chain, start, goal, deadline)
    return None if path is None else _shortened(free, path, rng)


def _connect(free: _Free, chain: Chain, start, goal, deadline) -> np.ndarray | None:
    n = len(start)
    space = ob.RealVectorStateSpace(n)
    space.setBounds(box(np.minimum.reduce([chain.lower, start, goal]), np.maximum.reduce([chain.upper, start, goal])))

    def read(state) -> np.ndarray:
        return np.array([state[i] for i in range(n)])

    si = ob.SpaceInformation(space)
    si.setStateValidityChecker(lambda state: bool(free.configurations(read(state)[None])))
    motions = _Motions(si, free, read)
    si.setMotionValidator(motions)
    si.setup()
    problem = ob.ProblemDefinition(si)
    first, last = si.allocState(), si.allocState()
    for i in range(n):
        first[i], last[i] = float(start[i]), float(goal[i])
    problem.setStartAndGoalStates(first, last)
    planner = og.RRTConnect(si)
    planner.setRange(RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(lambda: free.checks >= CHECKS or time.monotonic() >= deadline))
    if not problem.hasExactSolution():
        return None
    return np.array([read(s) for s in problem.getSolutionPath().getStates()])


def _shortened(free: _Free, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random shortcuts between points of the path."""
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        i, j = sorted(rng.integers(0, len(path) - 1, 2))
        a = path[i] + rng.random() * (path[i + 1] - path[i])
        b = path[j] + rng.random() * (path[j + 1] - path[j])
        if i != j and free.path(a, b):
            path = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
    return path


def resampled(path: np.ndarray, steps: int) -> np.ndarray:
    """``steps`` configurations (steps, n) evenly along a path, its end included, its start not."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], steps + 1)[1:]
    return np.stack([np.interp(at, length, path[:, i]) for i in range(path.shape[1])], axis=1)
