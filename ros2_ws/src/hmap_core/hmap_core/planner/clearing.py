"""Obstacles put out of the way: each removal is an instance of Algorithm 1 of its own."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from typing import Protocol

import numpy as np

from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner.assembly import state_after
from hmap_core.planner.interfaces import Grip, HeldPath, SegmentMotion
from hmap_core.planner.obstruction import carried_by
from hmap_core.planner.removal import given_place, removal_places
from hmap_core.planner.sweep import Sweep
from hmap_core.types import Goal, Scene, SceneState

PLACES = 10  # for one obstacle to which one contact is to carry it
PLACES_WITHOUT_CONTACT = 4  # after which several contacts are tried
PLACES_BY_STAGES = 3  # to which several contacts in turn are tried
PLACES_BLOCKED = 2  # to which other bodies bar the way, after which these are put aside as well
_STUCK = (Code.NO_CONTACT, Code.NO_MOTION)
_FINAL = (Code.TIME_LIMIT, Code.CANCELED, Code.SERVICE_UNAVAILABLE)


@dataclass(frozen=True)
class Errand:
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
    held: HeldPath | None = None
    reason: str = "to its goal"

    def raise_if_alone(self, blocker: str) -> None:
        """Raises BlockedError when nothing that is in the way may be moved."""
        if self.alone:
            raise BlockedError(f"'{blocker}' is in the way of '{self.goal.object}'", Code.NO_OBJECT_PATH)


@dataclass(frozen=True)
class Course:
    """How far an attempt has come.

    Attributes:
        state: where everything is.
        motions: those so far.
        aside: what was put out of the way.
        depth: of the deepest removal.
        grip: on the tool in a hand.
    """

    state: SceneState
    motions: tuple[SegmentMotion, ...] = ()
    aside: tuple[str, ...] = ()
    depth: int = 0
    grip: Grip | None = None

    def after(self, motion: SegmentMotion) -> "Course":
        """One motion later."""
        return replace(self, state=state_after(self.state, motion), motions=(*self.motions, motion))


class RemovalError(PlannerError):
    """An obstacle could not be put out of the way; the code is that of the last try."""


class BlockedError(RemovalError):
    """Something else would have to go first, which may not be moved for this errand."""


class Instance(Protocol):
    """What clearing needs of the planner."""

    scene: Scene
    rng: np.random.Generator

    def bring(self, errand: Errand, course: Course) -> Course:
        """The whole algorithm for one object. Raises HmapError, of which TIME_LIMIT and the like end the job."""
        ...


def may_go(scene: Scene, errand: Errand, course: Course) -> tuple[str, ...]:
    """The bodies that an errand may put out of its way."""
    stay = {errand.goal.object, scene.goal.object, *errand.busy, *course.aside}
    return tuple(name for name in scene.removable if name not in stay)


def raise_if_final(error: HmapError) -> None:
    """Raises an error that ends the whole job."""
    if error.code in _FINAL:
        raise error


@dataclass
class Clearing:
    """Puts obstacles out of the way of an errand, in an order that works.

    At most n removals are begun for each of n removable bodies, and none is tried twice in the same arrangement.

    Attributes:
        planner: plans each removal.
        begun: removals begun so far.
        failed: why a body could not be removed, by name and arrangement.
    """

    planner: Instance
    begun: int = 0
    failed: dict[tuple, HmapError] = field(default_factory=dict)

    def clear(self, errand: Errand, course: Course, names: Sequence[str], ways: Sequence[Sweep]) -> Course:
        """Puts bodies aside one after the other; those that cannot go yet come last.

        Args:
            ways: where the errand's object, and what carries it, will pass.

        Raises:
            RemovalError: one could not be put aside, with the reason.
        """
        errand.raise_if_alone(names[0])
        waiting, failure = list(names), None
        while waiting:
            before = len(waiting)
            for name in list(waiting):
                if name not in course.aside:
                    try:
                        course = self._remove(name, errand, course, ways, frozenset(waiting))
                    except HmapError as error:
                        raise_if_final(error)
                        failure = name, error
                        continue
                waiting.remove(name)
            if len(waiting) == before:
                name, error = failure
                raise RemovalError(
                    f"'{name}' is in the way of '{errand.goal.object}' and cannot be put aside: {error.reason}",
                    error.code,
                ) from error
        return course

    def _remove(self, name: str, errand: Errand, course: Course, ways, waiting: frozenset[str]) -> Course:
        """Puts one body aside; nothing is put on those that are ``waiting`` to go."""
        scene = self.planner.scene
        self._count()
        key = name, errand.busy, tuple(T.tobytes() for T in course.state.poses.values())
        if key in self.failed:
            raise self.failed[key]
        keep_out = (*errand.keep_out, *ways)
        own = Errand(
            Goal(name, course.state.poses[name]),
            errand.busy | {errand.goal.object},
            keep_out,
            errand.depth + 1,
            reason=f"out of the way of '{errand.goal.object}'",
        )
        try:
            course = self._unload(name, own, course)
            others = may_go(scene, own, course)
            unsteady = waiting | own.busy | set(others)
            found = removal_places(scene, course.state, name, keep_out, unsteady, self.planner.rng)
            given = given_place(scene, name, keep_out)
            moved = self._to_first(
                given, islice(found, PLACES), replace(own, alone=True), own if others else None, course
            )
        except HmapError as error:
            self.failed[key] = error
            raise
        return replace(moved, aside=(*moved.aside, name), depth=max(moved.depth, own.depth))

    def _to_first(
        self, given: Sequence[np.ndarray], places: Iterable[np.ndarray], alone: Errand, own: Errand | None, course
    ) -> Course:
        """Brings a body to the first place to which it can go.

        Args:
            given: what the task gives; places: those that are computed, the best first.
            alone: the errand as long as nothing else is moved.
            own: that which may move others; None where there are none.
        """
        tries = _Tries(self.planner, course)
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

    def _unload(self, name: str, own: Errand, course: Course) -> Course:
        """Puts aside what stands on a body."""
        load = carried_by(self.planner.scene, course.state, name)
        stays = [other for other in load if other not in may_go(self.planner.scene, own, course)]
        if stays:
            raise RemovalError(f"'{name}' carries '{stays[0]}', which may not be moved", Code.NO_OBJECT_PATH)
        return self.clear(own, course, load, ()) if load else course

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

    def __init__(self, planner: Instance, course: Course):
        self._planner, self._course = planner, course
        self.blocked: list[np.ndarray] = []
        self.stuck: list[np.ndarray] = []
        self.failure: HmapError | None = None
        self._without_contact = 0

    @property
    def enough(self) -> bool:
        """Whether further places are not likely to be better."""
        return len(self.blocked) >= PLACES_BLOCKED or self._without_contact >= PLACES_WITHOUT_CONTACT

    def first(self, errand: Errand, places: Iterable[np.ndarray]) -> Course | None:
        """The course after the errand to the first place that it gets to."""
        for T in places:
            try:
                return self._planner.bring(replace(errand, goal=replace(errand.goal, pose=T)), self._course)
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
