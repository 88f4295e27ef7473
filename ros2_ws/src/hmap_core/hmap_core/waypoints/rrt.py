"""RRTConnect on the object alone (Kuffner & LaValle, ICRA 2000; here OMPL's), with exact compiled motion checks."""

import time

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from hmap_core.transforms import quaternion_multiply
from hmap_core.waypoints.checker import ObjectChecker, planar_pose
from hmap_core.waypoints.ompl_seeding import box, seeded

# longest step of a tree as a fraction of the space's extent, and motions checked before the next is tried
ROUNDS = ((0.3, 400), (0.1, 800), (0.03, 1600))


class _Planar:
    """SE(2) around a start pose."""

    def __init__(self, start: np.ndarray, bounds: np.ndarray, radius: float):
        self._start = start
        self.space = ob.SE2StateSpace()
        self.space.setBounds(box(bounds[0, :2], bounds[1, :2]))
        self.space.setSubspaceWeight(0, 1.0)
        self.space.setSubspaceWeight(1, radius)

    def pose(self, state) -> np.ndarray:
        return planar_pose(self._start, state.getX(), state.getY(), state.getYaw())

    def write(self, T: np.ndarray, state) -> None:
        turn = _relative(self._start, T)
        state.setX(float(T[0]))
        state.setY(float(T[1]))
        state.setYaw(float((2.0 * np.arctan2(turn[2], turn[3]) + np.pi) % (2.0 * np.pi) - np.pi))


class _Spatial:
    """SE(3)."""

    def __init__(self, bounds: np.ndarray, radius: float):
        self.space = ob.SE3StateSpace()
        self.space.setBounds(box(*bounds))
        self.space.setSubspaceWeight(0, 1.0)
        self.space.setSubspaceWeight(1, 2.0 * radius)  # its distance of rotations is half the angle

    def pose(self, state) -> np.ndarray:
        q = state.rotation()
        return np.array([state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w])

    def write(self, T: np.ndarray, state) -> None:
        state.setXYZ(float(T[0]), float(T[1]), float(T[2]))
        q = state.rotation()
        q.x, q.y, q.z, q.w = (float(v) for v in T[3:])


def _relative(T0: np.ndarray, T1: np.ndarray) -> np.ndarray:
    """Quaternion (4,) that turns T0 into T1 about world axes."""
    return quaternion_multiply(T1[3:], T0[3:] * [-1.0, -1.0, -1.0, 1.0])


class _Motions(ob.MotionValidator):
    def __init__(self, si, checker: ObjectChecker, pose):
        super().__init__(si)
        self._checker, self._pose = checker, pose

    def checkMotion(self, first, second) -> bool:
        return bool(self._checker.motion_free(self._pose(first), self._pose(second)))


def rrt_path(
    checker: ObjectChecker,
    starts: list[np.ndarray],
    goals: list[np.ndarray],
    bounds: np.ndarray,
    rng: np.random.Generator,
    deadline: float,
    scale: int = 1,
) -> np.ndarray | None:
    """Poses (n, 7) of a free path from any of ``starts`` to any of ``goals``, or None when the ROUNDS are used up.

    Args:
        checker: what is free; poses are those of its kind of motion.
        starts, goals: poses (7,), free, reachable from the true start and goal.
        bounds: (2, 3) lower and upper position, m.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which to give up.
        scale: each round checks this many times its motions.
    """
    for fraction, budget in ROUNDS:
        with seeded(rng):
            path = _solve(checker, starts, goals, bounds, fraction, budget * scale, deadline)
        if path is not None or time.monotonic() >= deadline:
            return path
    return None


def _solve(checker, starts, goals, bounds, fraction, budget, deadline) -> np.ndarray | None:
    radius = checker.radius
    kind = _Planar(starts[0], bounds, radius) if checker.planar else _Spatial(bounds, radius)
    si = ob.SpaceInformation(kind.space)
    si.setStateValidityChecker(lambda state: bool(checker.pose_free(kind.pose(state))))
    motions = _Motions(si, checker, kind.pose)
    si.setMotionValidator(motions)
    si.setup()
    problem = ob.ProblemDefinition(si)
    target = ob.GoalStates(si)
    state = si.allocState()
    for T in starts:
        kind.write(T, state)
        problem.addStartState(state)
    for T in goals:
        kind.write(T, state)
        target.addState(state)
    problem.setGoal(target)
    planner = og.RRTConnect(si)
    planner.setRange(fraction * float(kind.space.getMaximumExtent()))
    planner.setProblemDefinition(problem)
    planner.setup()
    last = checker.checks + budget
    planner.solve(ob.PlannerTerminationCondition(lambda: checker.checks >= last or time.monotonic() >= deadline))
    if not problem.hasExactSolution():
        return None
    return np.array([kind.pose(s) for s in problem.getSolutionPath().getStates()])
