"""Which bodies have to go so that the object has a path: as few as a linear number of searches finds."""

from dataclasses import dataclass

import numpy as np

from hmap_core.waypoints.checker import Geometry, ObjectChecker, recentred
from hmap_core.waypoints.effort import Effort
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import resample
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.search import Corners, ObjectSearch, search_bounds

# rounds of a search that decides whether one body may stay
ROUNDS_PER_BODY = 1
# other ways that are looked at to see whether they need fewer bodies gone
ALTERNATIVES = 3


@dataclass(frozen=True)
class Removal:
    """Bodies to put out of the way, and a path that is free when they have gone."""

    names: tuple[str, ...]  # in the order of the stretches of the path that run into them
    corners: Corners


def fewest_removals(
    problem: ObjectPathProblem,
    found: Corners,
    needed: frozenset[str],
    rng: np.random.Generator,
    effort: Effort,
) -> Removal:
    """Bodies without which there is a path; none of them could stay, as far as the searches can tell.

    A path through all removable bodies tells which have to go for it. Those of them that could stay while the others go
    are found one by one. What is left belongs to one way; with all of these bodies in their places, then with
    single ones, other ways are sought, and one that needs fewer is taken. The exact minimum is NP-hard (Hauser, "The
    minimum constraint removal problem with three robotics applications", IJRR 2014); here the number of
    searches is at most (2 + ALTERNATIVES) times the number of bodies.

    Args:
        problem: the problem with all its obstacles; known to have no path.
        found: a path without any of the removable ones.
        needed: removable bodies that stand where the object has to go.
        rng: the only source of randomness.
        effort: what may be done at most; then what is known is the answer.
    """
    best = _Fewest(problem, needed, rng, effort).search(found)
    checker = checker_like(best.corners, problem.without(frozenset(best.names)))
    return Removal(best.names, Corners(best.corners.poses, checker, best.corners.middle))


class _Fewest:
    def __init__(self, problem, needed, rng, effort: Effort):
        self.problem, self.needed, self.rng, self.effort = problem, needed, rng, effort
        self.vital = set(needed)  # have to go whatever else goes

    def search(self, found: Corners) -> Removal:
        best = self._trimmed(self._of(found), np.inf)
        left = ALTERNATIVES
        questions = self._questions(best)
        while questions and left and len(best.names) > max(1, len(self.vital)) and not self.effort.over:
            staying = questions.pop(0)
            other = self._without(self.problem.removable - staying)
            if other is None:
                self.vital |= staying if len(staying) == 1 else set()
                continue
            left -= 1
            other = self._trimmed(other, len(best.names))
            if len(other.names) < len(best.names):
                best = other
                questions = self._questions(best)
        return best

    def _questions(self, removal: Removal) -> list[frozenset[str]]:
        """Sets of bodies to leave in their places, so as to find another way."""
        names = [name for name in removal.names if name not in self.vital]
        together = [frozenset(names)] if len(names) > 1 else []
        return together + [frozenset({name}) for name in names]

    def _trimmed(self, removal: Removal, limit: float) -> Removal:
        """Let those stay that need not go; given up when ``limit`` bodies or more have to."""
        stuck = set(self.vital)
        while not self.effort.over and len(stuck) < limit:
            name = next((n for n in removal.names if n not in stuck), None)
            if name is None or len(removal.names) == 1:
                break
            gone = frozenset(removal.names) - {name}
            fewer = self._round(removal.corners, gone) or self._without(gone)
            if fewer is None:
                stuck.add(name)
            else:
                removal = fewer
        return removal

    def _without(self, gone: frozenset[str]) -> Removal | None:
        """What a search with these bodies gone, and all others in their places, finds."""
        corners = ObjectSearch(self.problem.without(gone)).rounds(self.rng, self.effort, ROUNDS_PER_BODY)
        return None if corners is None else self._of(corners)

    def _round(self, corners: Corners, gone: frozenset[str]) -> Removal | None:
        """A detour of a path round what it runs into with only these bodies gone; a short search finds it or not."""
        checker = checker_like(corners, self.problem.without(gone))
        dense, _ = resample(corners.poses)
        free = np.array([checker.motion_free(a, b) for a, b in zip(dense[:-1], dense[1:], strict=True)])
        if free.all():
            return self._of(Corners(dense, checker, corners.middle))
        first, last = int(np.argmin(free)), len(free) - int(np.argmin(free[::-1]))
        bounds = search_bounds(recentred(self.problem, corners.middle), checker)
        way = rrt_path(checker, [dense[first]], [dense[last]], bounds, self.rng, self.effort, rounds=ROUNDS[:1])
        if way is None:
            return None
        return self._of(Corners(np.concatenate([dense[:first], way, dense[last + 1 :]]), checker, corners.middle))

    def _of(self, corners: Corners) -> Removal:
        return Removal(removables_hit(self.problem, corners, self.needed), corners)


def removables_hit(problem: ObjectPathProblem, found: Corners, needed: frozenset[str]) -> tuple[str, ...]:
    """Removable bodies that a path runs into, in the order of its stretches, and the ``needed`` ones."""
    checker = checker_like(found, problem)
    hit: list[str] = []
    for a, b in zip(found.poses[:-1], found.poses[1:], strict=True):
        hit += [name for name in checker.hit_by(a, b) if name in problem.removable]
    return tuple(dict.fromkeys([*hit, *sorted(needed)]))


def checker_like(found: Corners, problem: ObjectPathProblem) -> ObjectChecker:
    """A checker for the obstacles of ``problem`` with the kind of motion, minimum distance and frame of a path."""
    central = recentred(problem, found.middle)
    return ObjectChecker(central, Geometry(central), found.checker.planar, found.checker.min_distance)
