"""Obstacles put out of the way: each removal is an instance of Algorithm 1 of its own."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from typing import Protocol

import numpy as np

from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner.assembly import state_after
from hmap_core.planner.interfaces import AttachedPath, SubTrajectory, ToolGrasp
from hmap_core.planner.obstruction import carried_by
from hmap_core.planner.placements import given_place, placements_of
from hmap_core.planner.sweep import Sweep
from hmap_core.types import Goal, Scene, SceneState

PLACES = 10  # for one obstacle to which one contact is to carry it
PLACES_WITHOUT_CONTACT = 4  # after which several contacts are tried
PLACES_BY_STAGES = 3  # to which several contacts in turn are tried
PLACES_BLOCKED = 2  # to which other bodies bar the way, after which these are put aside as well
_STUCK = (Code.NO_CONTACT, Code.NO_MOTION)
_FINAL = (Code.TIME_LIMIT, Code.CANCELED, Code.SERVICE_UNAVAILABLE)


@dataclass(frozen=True)
class Subgoal:
    """What one instance of the algorithm brings where.

    Attributes:
        goal: of its object.
        busy: bodies that it may not move: the objects of the instances above it, and what they keep where it is.
        keep_out: where these will pass; nothing may be put there.
        depth: how many instances are above it.
        alone: it fails where something else would have to go first.
        whole: one contact has to carry its object all the way.
        held: the path that it goes along, where that was sought for a hand.
        reason: for people: why.
    """

    goal: Goal
    busy: frozenset[str] = frozenset()
    keep_out: tuple[Sweep, ...] = ()
    depth: int = 0
    alone: bool = False
    whole: bool = False
    held: AttachedPath | None = None
    reason: str = "to its goal"

    def raise_if_alone(self, blocker: str) -> None:
        """Raises BlockedError when nothing that is in the way may be moved."""
        if self.alone:
            raise BlockedError(f"'{blocker}' is in the way of '{self.goal.object}'", Code.NO_OBJECT_PATH)


@dataclass(frozen=True)
class SolutionSequence:
    """How far an attempt has come.

    Attributes:
        state: where everything is.
        motions: those so far.
        aside: what was put out of the way.
        depth: of the deepest removal.
        grip: on the tool in a hand.
    """

    state: SceneState
    motions: tuple[SubTrajectory, ...] = ()
    aside: tuple[str, ...] = ()
    depth: int = 0
    grip: ToolGrasp | None = None

    def after(self, motion: SubTrajectory) -> "SolutionSequence":
        """One motion later."""
        return replace(self, state=state_after(self.state, motion), motions=(*self.motions, motion))


class RemovalError(PlannerError):
    """An obstacle could not be put out of the way; the code is that of the last try."""


class BlockedError(RemovalError):
    """Something else would have to go first, which may not be moved for this subgoal."""


class Instance(Protocol):
    """What removal needs of the planner."""

    scene: Scene
    rng: np.random.Generator

    def bring(self, subgoal: Subgoal, solution: SolutionSequence) -> SolutionSequence:
        """The whole algorithm for one object. Raises HmapError, of which TIME_LIMIT and the like end the job."""
        ...


def may_go(scene: Scene, subgoal: Subgoal, solution: SolutionSequence) -> tuple[str, ...]:
    """The bodies that an subgoal may put out of its way."""
    stay = {subgoal.goal.object, scene.goal.object, *subgoal.busy, *solution.aside}
    return tuple(name for name in scene.removable if name not in stay)


def raise_if_final(error: HmapError) -> None:
    """Raises an error that ends the whole job."""
    if error.code in _FINAL:
        raise error


@dataclass
class ObstacleRemoval:
    """Puts obstacles out of the way of an subgoal, in an order that works.

    At most n removals are begun for each of n removable bodies, and none is tried twice in the same arrangement.

    Attributes:
        planner: plans each removal.
        begun: removals begun so far.
        failed: why a body could not be removed, by name and arrangement.
    """

    planner: Instance
    begun: int = 0
    failed: dict[tuple, HmapError] = field(default_factory=dict)

    def clear(
        self, subgoal: Subgoal, solution: SolutionSequence, names: Sequence[str], ways: Sequence[Sweep]
    ) -> SolutionSequence:
        """Puts bodies aside one after the other; those that cannot go yet come last.

        Args:
            ways: where the subgoal's object, and what carries it, will pass.

        Raises:
            RemovalError: one could not be put aside, with the reason.
        """
        subgoal.raise_if_alone(names[0])
        waiting, failure = list(names), None
        while waiting:
            before = len(waiting)
            for name in list(waiting):
                if name not in solution.aside:
                    try:
                        solution = self._remove(name, subgoal, solution, ways, frozenset(waiting))
                    except HmapError as error:
                        raise_if_final(error)
                        failure = name, error
                        continue
                waiting.remove(name)
            if len(waiting) == before:
                name, error = failure
                raise RemovalError(
                    f"'{name}' is in the way of '{subgoal.goal.object}' and cannot be put aside: {error.reason}",
                    error.code,
                ) from error
        return solution

    def _remove(
        self, name: str, subgoal: Subgoal, solution: SolutionSequence, ways, waiting: frozenset[str]
    ) -> SolutionSequence:
        """Puts one body aside; nothing is put on those that are ``waiting`` to go."""
        scene = self.planner.scene
        self._count()
        key = name, subgoal.busy, tuple(T.tobytes() for T in solution.state.poses.values())
        if key in self.failed:
            raise self.failed[key]
        keep_out = (*subgoal.keep_out, *ways)
        own = Subgoal(
            Goal(name, solution.state.poses[name]),
            subgoal.busy | {subgoal.goal.object},
            keep_out,
            subgoal.depth + 1,
            reason=f"out of the way of '{subgoal.goal.object}'",
        )
        try:
            solution = self._unload(name, own, solution)
            others = may_go(scene, own, solution)
            unsteady = waiting | own.busy | set(others)
            found = placements_of(scene, solution.state, name, keep_out, unsteady, self.planner.rng)
            given = given_place(scene, name, keep_out)
            moved = self._to_first(
                given, islice(found, PLACES), replace(own, alone=True), own if others else None, solution
            )
        except HmapError as error:
            self.failed[key] = error
            raise
        return replace(moved, aside=(*moved.aside, name), depth=max(moved.depth, own.depth))

    def _to_first(
        self, given: Sequence[np.ndarray], places: Iterable[np.ndarray], alone: Subgoal, own: Subgoal | None, solution
    ) -> SolutionSequence:
        """Brings a body to the first place to which it can go.

        Args:
            given: what the task gives; places: those that are computed, the best first.
            alone: the subgoal as long as nothing else is moved.
            own: that which may move others; None where there are none.
        """
        tries = _Tries(self.planner, solution)
        found = tries.first(alone, given)
        if found is None:
            found = tries.first(replace(alone, whole=True), takewhile(lambda _: not tries.enough, places))
        if found is None:
            found = tries.first(alone, tries.stuck[:PLACES_BY_STAGES])
        if found is None and own is not None:
            found = tries.first(own, tries.blocked[:PLACES_BLOCKED])
        if found is None:
            raise tries.failure or RemovalError(f"no place for '{alone.goal.object}' is free", Code.NO_OBJECT_PATH)
        return found

    def _unload(self, name: str, own: Subgoal, solution: SolutionSequence) -> SolutionSequence:
        """Puts aside what stands on a body."""
        load = carried_by(self.planner.scene, solution.state, name)
        stays = [other for other in load if other not in may_go(self.planner.scene, own, solution)]
        if stays:
            raise RemovalError(f"'{name}' carries '{stays[0]}', which may not be moved", Code.NO_OBJECT_PATH)
        return self.clear(own, solution, load, ()) if load else solution

    def _count(self) -> None:
        most = len(self.planner.scene.removable) ** 2
        if self.begun >= most:
            raise RemovalError(f"{most} removals were begun, which is all that is tried", Code.NO_MOTION)
        self.begun += 1


class _Tries:
    """Tries to bring a body to one of several places, and how they ended.

    Attributes:
        blocked: places to which other bodies bar the way.
        stuck: places to which there is a path, but no contacts or motions that follow it.
        failure: why the last try failed.
    """

    def __init__(self, planner: Instance, solution: SolutionSequence):
        self._planner, self._course = planner, solution
        self.blocked: list[np.ndarray] = []
        self.stuck: list[np.ndarray] = []
        self.failure: HmapError | None = None
        self._without_contact = 0

    @property
    def enough(self) -> bool:
        """Whether further places are not likely to be better."""
        return len(self.blocked) >= PLACES_BLOCKED or self._without_contact >= PLACES_WITHOUT_CONTACT

    def first(self, subgoal: Subgoal, places: Iterable[np.ndarray]) -> SolutionSequence | None:
        """The solution after the subgoal to the first place that it gets to."""
        for T in places:
            try:
                return self._planner.bring(replace(subgoal, goal=replace(subgoal.goal, pose=T)), self._course)
            except BlockedError as error:
                self.failure = error
                self.blocked.append(T)
            except HmapError as error:
                raise_if_final(error)
                self.failure = error
                self._without_contact += error.code == Code.NO_CONTACT
                if error.code in _STUCK:
                    self.stuck.append(T)
        return None
