"""Obstacles are removed from the way: each removal is an instance of Algorithm 1 of its own."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from typing import Protocol

import numpy as np

from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner.contact_filters import NoneServes
from hmap_core.planner.context import SearchContext
from hmap_core.planner.diagnosis import hand_fits
from hmap_core.planner.immovable import why_immovable
from hmap_core.planner.obstruction import carried_by
from hmap_core.planner.outcome import Failure, Outcome
from hmap_core.planner.placements import given_place, placements_of
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal, removable_for
from hmap_core.planner.sweep import Sweep
from hmap_core.planner.tools import tools_of, with_tool_placed
from hmap_core.types import Goal, Scene, SceneState, TaskMode

PLACES = 10  # for one obstacle to which one contact has to carry it
PLACES_WITHOUT_CONTACT = 4  # after which several contacts in turn are tried
PLACES_UNREACHED = 2  # after which the body counts as out of reach where it is: no contact was feasible at all
PLACES_ALIKE = 2  # of these at one height, after which places at other heights come first
PLACES_BY_STAGES = 3  # to which several contacts in turn are tried
PLACES_BLOCKED = 2  # to which other bodies block the way, after which these are removed as well
_STUCK = (Code.NO_CONTACT, Code.NO_MOTION)
_FINAL = (Code.TIME_LIMIT, Code.CANCELED, Code.SERVICE_UNAVAILABLE)


class RemovalError(PlannerError):
    """An obstacle could not be removed; the code is that of the last try.

    Attributes:
        body: name of the obstacle; empty if it is not known.
    """

    body = ""


class StuckError(RemovalError):
    """An obstacle without which there is no path cannot be moved by anything; further paths do not help."""


class BlockedError(RemovalError):
    """Another body would have to be removed first, which may not be moved for this subgoal."""


class PostponedError(BlockedError):
    """A body is removed after others, if these can be removed."""


class Instance(Protocol):
    """What removal needs of the search."""

    context: SearchContext

    def bring(self, subgoal: Subgoal, sequence: SolutionSequence) -> Outcome:
        """Run the whole algorithm for one object."""
        ...


def raise_if_alone(subgoal: Subgoal, blocker: str) -> None:
    """Raise BlockedError if a body is in the way of a subgoal for which no other body may be moved."""
    if subgoal.alone:
        raise blocked(subgoal, blocker)


def blocked(subgoal: Subgoal, blocker: str) -> BlockedError:
    """The failure of a subgoal for which no other body may be moved, and a body is in its way."""
    return BlockedError(f"'{blocker}' is in the way of '{subgoal.goal.object}'", Code.NO_OBJECT_PATH)


def raise_if_final(error: HmapError) -> None:
    """Raise an error again if it ends the whole job: time limit, cancel, a service that is away."""
    if error.code in _FINAL:
        raise error


@dataclass
class ObstacleRemoval:
    """Removes obstacles from the way of a subgoal, in an order that works.

    At most n removals are begun for each of n removable bodies and one object path, and none is tried twice in the same
    arrangement. Bodies on which a hand fits come before those that others hide.

    Attributes:
        search: plans each removal.
        begun: number of removals begun so far.
        failed: why a body could not be removed, by name and arrangement.
    """

    search: Instance
    begun: int = 0
    failed: dict[tuple, HmapError] = field(default_factory=dict)
    _fitting: dict[tuple, bool] = field(default_factory=dict)
    _postponed: dict[tuple, "_Tries"] = field(default_factory=dict)

    @property
    def _scene(self) -> Scene:
        return self.search.context.scene

    def new_path(self, subgoal: Subgoal) -> None:
        """Count removals from the start, since another path of the task's object is tried."""
        if subgoal.depth == 0:
            self.begun = 0

    def clear(
        self, subgoal: Subgoal, sequence: SolutionSequence, names: Sequence[str], sweeps: Sequence[Sweep]
    ) -> SolutionSequence:
        """Remove bodies one after the other; those that cannot be removed yet come last.

        Args:
            subgoal: for which they are removed.
            sequence: what has been done already.
            names: of the bodies.
            sweeps: volumes through which the object of the subgoal, and what carries it, will pass.

        Raises:
            RemovalError: one could not be removed, with the reason.
        """
        raise_if_alone(subgoal, names[0])
        waiting = list(names)
        failure: tuple[str, HmapError] | None = None
        others_first = len(waiting) > 1  # a body that others cover waits for these
        while waiting:
            before = len(waiting)
            for name in self._within_reach(waiting, sequence):
                if name not in sequence.aside:
                    try:
                        sequence = self._remove(name, subgoal, sequence, sweeps, frozenset(waiting), others_first)
                    except HmapError as error:
                        raise_if_final(error)
                        failure = name, error
                        continue
                waiting.remove(name)
            if len(waiting) == before and others_first:
                others_first = False
                continue
            others_first = len(waiting) > 1
            if len(waiting) == before and failure is not None:
                name, cause = failure
                stuck = RemovalError(
                    f"'{name}' is in the way of '{subgoal.goal.object}' and cannot be removed: {cause.reason}",
                    cause.code,
                )
                stuck.body = name
                raise stuck from cause
        return sequence

    def _within_reach(self, waiting: Sequence[str], sequence: SolutionSequence) -> list[str]:
        """Those of some bodies on which a hand fits where they are; all of them if none does, or if there are tools."""
        if len(waiting) < 2:
            return list(waiting)
        fitting = [name for name in waiting if name in sequence.aside or self._hand_fits(name, sequence.state)]
        return fitting or list(waiting)

    def _hand_fits(self, name: str, state: SceneState) -> bool:
        """Whether a hand fits on a body where it is; True where that is not all there is, as there are tools."""
        scene = self._scene
        if scene.mode == TaskMode.KINEMATIC or tools_of(scene, scene.goal.object):
            return True
        key = name, *(T.tobytes() for T in state.poses.values())
        if key not in self._fitting:
            self._fitting[key] = hand_fits(scene, state, name)
        return self._fitting[key]

    def _remove(
        self,
        name: str,
        subgoal: Subgoal,
        sequence: SolutionSequence,
        sweeps: Sequence[Sweep],
        waiting: frozenset[str],
        others_first: bool,
    ) -> SolutionSequence:
        """Remove one body; nothing is placed on those that are ``waiting`` to be removed.

        Raises:
            BlockedError: ``others_first``, and others are in its way.
        """
        key = name, subgoal.busy, tuple(T.tobytes() for T in sequence.state.poses.values())
        if key in self.failed:
            raise self.failed[key]
        self._count()
        keep_out = (*subgoal.keep_out, *sweeps)
        own = Subgoal(
            Goal(name, sequence.state.poses[name]),
            subgoal.busy | {subgoal.goal.object},
            keep_out,
            subgoal.depth + 1,
            reason=f"out of the way of '{subgoal.goal.object}'",
        )
        try:
            sequence = self._unload(name, own, sequence)
            others = removable_for(self._scene, own, sequence)
            unsteady = waiting | own.busy | set(others)
            rng = self.search.context.rng
            found = placements_of(self._scene, sequence.state, name, keep_out, unsteady, rng)
            given = given_place(self._scene, name, keep_out)
            alone = replace(own, alone=True)
            if others and not self._hand_fits(name, sequence.state):
                moved = self._uncovered(own, islice((*given, *islice(found, PLACES_BLOCKED)), PLACES_BLOCKED), sequence)
            else:
                tries = self._postponed.pop(key, None) or self._tried(given, islice(found, PLACES), alone, sequence)
                if tries.done is None and others_first and tries.blocked:
                    self._postponed[key] = tries
                    self.begun -= 1
                    raise PostponedError(f"'{name}' is behind others", Code.NO_OBJECT_PATH)
                moved = self._to_first(tries, alone, own if others else None)
        except PostponedError:
            raise
        except HmapError as error:
            self.failed[key] = error
            raise
        return replace(moved, aside=(*moved.aside, name), depth=max(moved.depth, own.depth))

    def _tried(
        self, given: Sequence[np.ndarray], places: Iterable[np.ndarray], alone: Subgoal, sequence: SolutionSequence
    ) -> "_Tries":
        """Try to bring a body to one of some places by one contact, with all others where they are.

        Args:
            given: places that the task gives, for which several contacts are allowed.
            places: places that are computed, the best first.
            alone: the subgoal as long as no other body is moved.
            sequence: what has been done already.
        """
        tries = _Tries(self.search, sequence)
        tries.done = tries.first(alone, given)
        if tries.done is None:
            varied = takewhile(lambda _: not tries.enough, tries.varied(places))
            tries.done = tries.first(replace(alone, whole=True), varied)
        return tries

    def _to_first(self, tries: "_Tries", alone: Subgoal, own: Subgoal | None) -> SolutionSequence:
        """Bring a body to the first place to which it can go.

        Args:
            tries: what one contact has reached.
            alone: the subgoal as long as no other body is moved.
            own: the subgoal that may move others; None if there are none.
        """
        found = tries.done
        if found is None:
            found = tries.first(alone, tries.stuck[:PLACES_BY_STAGES])
        if found is None and own is not None:
            found = tries.first(own, tries.blocked[:PLACES_BLOCKED])
        if found is None:
            raise tries.failure or RemovalError(f"no place for '{alone.goal.object}' is free", Code.NO_OBJECT_PATH)
        return found

    def _uncovered(self, own: Subgoal, places: Iterable[np.ndarray], sequence: SolutionSequence) -> SolutionSequence:
        """Bring a body on which no hand fits to one of some places, once others are removed from around it."""
        tries = _Tries(self.search, sequence)
        found = tries.first(own, places)
        if found is None:
            raise tries.failure or RemovalError(f"no place for '{own.goal.object}' is free", Code.NO_OBJECT_PATH)
        return found

    def _unload(self, name: str, own: Subgoal, sequence: SolutionSequence) -> SolutionSequence:
        """Remove what stands on a body."""
        load = carried_by(self._scene, sequence.state, name)
        stays = [other for other in load if other not in removable_for(self._scene, own, sequence)]
        if stays:
            raise RemovalError(f"'{name}' carries '{stays[0]}', which may not be moved", Code.NO_OBJECT_PATH)
        return self.clear(own, sequence, load, ()) if load else sequence

    def _count(self) -> None:
        most = len(self._scene.removable) ** 2
        if self.begun >= most:
            raise RemovalError(f"{most} removals were begun, which is all that is tried", Code.NO_MOTION)
        self.begun += 1


class _Tries:
    """Tries to bring a body to one of several places, and how they ended.

    Attributes:
        blocked: places to which other bodies block the way.
        stuck: places to which there is a path, but no contacts or motions that follow it.
        failure: why the last try failed.
        done: the sequence after a try that was successful.
    """

    def __init__(self, search: Instance, sequence: SolutionSequence):
        self._search, self._sequence = search, sequence
        self.blocked: list[np.ndarray] = []
        self.stuck: list[np.ndarray] = []
        self.failure: HmapError | None = None
        self.done: SolutionSequence | None = None
        self._without_contact = 0
        self._unreached = 0
        self._at_height: Counter[int] = Counter()  # places without contact, by height in mm

    @property
    def enough(self) -> bool:
        """Whether further places are not likely to be better."""
        unreached = self._unreached >= PLACES_UNREACHED
        return unreached or len(self.blocked) >= PLACES_BLOCKED or self._without_contact >= PLACES_WITHOUT_CONTACT

    def varied(self, places: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        """The places in their order, but those at a height at which PLACES_ALIKE had no contact come last.

        A hand that cannot place a body on one board, in a cabinet, may on another.
        """
        alike = []
        for T in places:
            if self._at_height[_millimetres(T)] >= PLACES_ALIKE:
                alike.append(T)
            else:
                yield T
        yield from alike

    def first(self, subgoal: Subgoal, places: Iterable[np.ndarray]) -> SolutionSequence | None:
        """The sequence after the subgoal, at the first place to which the body can be brought."""
        for T in places:
            try:
                outcome = self._search.bring(replace(subgoal, goal=replace(subgoal.goal, pose=T)), self._sequence)
            except HmapError as error:
                raise_if_final(error)
                outcome = Failure.of(error)
            if not isinstance(outcome, Failure):
                return outcome.sequence
            self._failed(outcome, T)
            if outcome.code == Code.NO_CONTACT and self._without_contact == 1:
                self._check_immovable(subgoal.goal.object)
        return None

    def _check_immovable(self, name: str) -> None:
        """Raises RemovalError if nothing can move a body from where it is, whatever its place."""
        sequence = self._sequence
        why = why_immovable(self._search.context.scene, with_tool_placed(sequence.state, sequence.tool_grasp), name)
        if why:
            raise RemovalError(why, Code.NO_CONTACT)

    def _failed(self, failure: Failure, T: np.ndarray) -> None:
        self.failure = failure.error
        if isinstance(failure.error, BlockedError):
            self.blocked.append(T)
            return
        self._without_contact += failure.code == Code.NO_CONTACT
        served = failure.error is not None and isinstance(failure.error.__cause__, NoneServes)
        self._unreached += failure.code == Code.NO_CONTACT and not served
        self._at_height[_millimetres(T)] += failure.code == Code.NO_CONTACT
        if failure.code in _STUCK:
            self.stuck.append(T)


def _millimetres(T: np.ndarray) -> int:
    """Height of a pose (7,), rounded."""
    return round(1e3 * float(T[2]))
