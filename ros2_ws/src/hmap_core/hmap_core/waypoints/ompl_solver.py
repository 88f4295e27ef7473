"""One query to a planner of OMPL, in whatever space, with validity checks of hmap.

Şucan, Moll & Kavraki, "The Open Motion Planning Library", IEEE Robotics & Automation Magazine 2012. OMPL is imported
when a planner of it is asked for, not before.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from threading import RLock
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from hmap_core.exceptions import InputError

PREFIX = "ompl:"  # of the planners' names on the command line
# planners that cannot be used with checks in Python, and why
UNUSABLE = {
    "SPARS": "it checks motions from a second thread",
    "SPARStwo": "it checks motions from a second thread",
    "STRRTstar": "it plans in space-time alone",
}
# planners that check states along a motion by themselves (EITstar) do so at every such fraction of the space's extent:
# some 5 mm in scenes of 2 to 3 m. What they find counts only when its whole motions are free, too
STATE_RESOLUTION = 0.002
# any cost is good enough: planners that optimise stop at the first path
ANY_COST = 1e12
# of the free part of a blocked motion that is kept: a motion up to the contact itself may not be free by rounding
KEPT = 0.98
# distance in the space within which a path's ends are those asked for
SAME_STATE = 1e-6
# seeds of OMPL are drawn from 1 to this
MAX_SEED = 2**31 - 1
# OMPL's seed and log level belong to the process
_LOCK = RLock()


class Space(ABC):
    """A state space of OMPL whose states are read and written as arrays."""

    def __init__(self, space):
        self.ompl = space

    @abstractmethod
    def read(self, state) -> np.ndarray:
        """The array of a state."""

    @abstractmethod
    def write(self, state, values: np.ndarray) -> None:
        """Makes a state that of an array."""

    def state(self, values: np.ndarray):
        """A new state of an array."""
        state = self.ompl.allocState()
        self.write(state, values)
        return state


class Checks(Protocol):
    """What is free, asked with the arrays of a :class:`Space`."""

    @property
    def evaluations(self) -> int:
        """What was checked so far, in the unit in which :meth:`Query.solve` is limited."""

    def state_free(self, state: np.ndarray) -> bool:
        """Whether a state is free."""

    def motion_free(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the whole motion from a to b, as the space interpolates, is free."""

    def free_part(self, a: np.ndarray, b: np.ndarray) -> float:
        """Parameter in [0, 1] up to which the motion from a to b is free."""


@lru_cache(maxsize=1)
def modules() -> SimpleNamespace:
    """OMPL's modules ``base``, ``geometric`` and ``util``.

    Raises:
        InputError: OMPL is not installed.
    """
    try:
        import ompl

        # The wheel of 1.7.0 loads its library a second time for all to see, and the process crashes at its end. The
        # copy that its modules are linked to is enough.
        ompl.dll_loader = lambda lib, path: None
        from ompl import base, geometric, util
    except ImportError as error:
        raise InputError(f"planners '{PREFIX}...' need OMPL: pip install ompl==1.7.0 ({error})") from error
    return SimpleNamespace(base=base, geometric=geometric, util=util)


@lru_cache(maxsize=1)
def planner_names() -> tuple[str, ...]:
    """The geometric planners that the installed OMPL has and that can be used here, in alphabetical order.

    Raises:
        InputError: OMPL is not installed.
    """
    base, geometric = modules().base, modules().geometric
    classes = {name: value for name, value in vars(geometric).items() if isinstance(value, type)}
    return tuple(sorted(n for n, c in classes.items() if issubclass(c, base.Planner) and n not in UNUSABLE))


def known_planner(name: str) -> str:
    """The name of one of OMPL's planners, as it was given, with or without PREFIX.

    Raises:
        InputError: OMPL is not installed, or has no such planner, or it cannot be used here.
    """
    name = name.removeprefix(PREFIX)
    if name not in planner_names():
        reason = f"cannot be used here: {UNUSABLE[name]}" if name in UNUSABLE else "is unknown"
        raise InputError(f"planner '{PREFIX}{name}' {reason}; allowed: {', '.join(planner_names())}")
    return name


class Query:
    """One planner between two states; a query is solved once.

    Args:
        planner: one of :func:`planner_names`.
        space: where; made within :func:`seeded`.
        checks: what is free there.
        start, goal: arrays of states.
        step: longest step of planners that have one, as a fraction of the space's extent; None: OMPL's default.
    """

    def __init__(
        self, planner: str, space: Space, checks: Checks, start: np.ndarray, goal: np.ndarray, step: float | None = None
    ):
        self._limit: float = np.inf
        self._space, self._checks, self._ends = space, checks, (start, goal)
        base = modules().base
        self._information = base.SpaceInformation(space.ompl)
        self._information.setStateValidityChecker(base.StateValidityCheckerFn(self._state_free))
        self._validator = _validator_class()(self._information, self._motion_free, self._last_free)
        self._information.setMotionValidator(self._validator)
        self._information.setStateValidityCheckingResolution(STATE_RESOLUTION)
        self._information.setup()
        self._definition = base.ProblemDefinition(self._information)
        self._definition.setStartAndGoalStates(space.state(start), space.state(goal))
        objective = base.PathLengthOptimizationObjective(self._information)
        objective.setCostThreshold(base.Cost(ANY_COST))
        self._definition.setOptimizationObjective(objective)
        self._planner = getattr(modules().geometric, planner)(self._information)
        if step is not None and hasattr(self._planner, "setRange"):
            self._planner.setRange(step * space.ompl.getMaximumExtent())
        self._planner.setProblemDefinition(self._definition)
        self._planner.setup()

    def solve(self, evaluations: int, time_limit: float) -> np.ndarray | None:
        """The first path found, as arrays (n, ...) whose motions are free, or None.

        Args:
            evaluations: limit of the checks' evaluations, from the first one on.
            time_limit: wall-clock seconds.
        """
        base = modules().base
        self._limit = evaluations
        # conditions of C++ alone: planners with a second thread ask them from there
        self._condition = base.plannerOrTerminationCondition(
            base.timedPlannerTerminationCondition(time_limit),
            base.exactSolnPlannerTerminationCondition(self._definition),
        )
        self._planner.solve(self._condition)
        self._validator.motion_free = self._validator.last_free = None  # they refer back to this query
        if not self._definition.hasExactSolution():
            return None
        states = self._definition.getSolutionPath().getStates()
        path = np.array([self._space.read(state) for state in states])
        for k, end in ((0, self._ends[0]), (-1, self._ends[1])):
            if self._space.ompl.distance(states[k], self._space.state(end)) > SAME_STATE:
                return None
            path[k] = end
        free = all(self._checks.motion_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))
        return path if free else None

    def _state_free(self, state) -> bool:
        free = bool(self._checks.state_free(self._space.read(state)))
        self._stop_at_limit()
        return free

    def _motion_free(self, a, b) -> bool:
        free = bool(self._checks.motion_free(self._space.read(a), self._space.read(b)))
        self._stop_at_limit()
        return free

    def _last_free(self, a, b, state) -> float:
        """Parameter up to which the motion between two states is surely free; that state is put into ``state``."""
        at = KEPT * self._checks.free_part(self._space.read(a), self._space.read(b))
        kept = self._space.ompl.allocState()
        self._space.ompl.interpolate(a, b, at, kept)
        if not self._checks.motion_free(self._space.read(a), self._space.read(kept)):
            at = 0.0
            self._space.ompl.copyState(kept, a)
        if state is not None:
            self._space.ompl.copyState(state, kept)
        self._stop_at_limit()
        return at

    def _stop_at_limit(self) -> None:
        if self._checks.evaluations >= self._limit:
            self._condition.terminate()


@lru_cache(maxsize=1)
def _validator_class() -> type:
    base: Any = modules().base

    class Validator(base.MotionValidator):
        """Whole motions by hmap's checks."""

        def __init__(self, information, motion_free, last_free):
            super().__init__(information)
            self.motion_free, self.last_free = motion_free, last_free

        def checkMotion(self, a, b, last_valid=None):
            """OMPL's name for both forms; the second wants to know the last free state of a blocked motion."""
            if self.motion_free(a, b):
                return True
            if last_valid is not None:
                last_valid.second = self.last_free(a, b, last_valid.first)
            return False

    return Validator


def box_bounds(lower: np.ndarray, upper: np.ndarray):
    """OMPL's bounds of real numbers, from lower and upper (n,)."""
    bounds = modules().base.RealVectorBounds(len(lower))
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        bounds.setLow(k, float(low))
        bounds.setHigh(k, float(high))
    return bounds


@contextmanager
def seeded(rng: np.random.Generator) -> Iterator[None]:
    """A context in which OMPL's random numbers are those of a seed drawn from ``rng``, and its log is silent.

    OMPL has one seed for the process, from which each new generator takes its own. Setting it anew makes the generators
    that follow repeat, though OMPL logs that it does not. Space, query and solution therefore belong into one such
    context; threads take turns.
    """
    with _LOCK:
        util = modules().util
        level = util.getLogLevel()
        util.setLogLevel(util.LogLevel.LOG_NONE)
        try:
            util.RNG.setSeed(int(rng.integers(1, MAX_SEED)))
            yield
        finally:
            util.setLogLevel(level)
