"""Which removable bodies block the object's path: a small set of removals, found with a linear number of searches."""

from dataclasses import dataclass

import numpy as np

from hmap_core.waypoints.checker import Geometry, ObjectChecker, recentred
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import resample
from hmap_core.waypoints.rrt import ROUNDS, rrt_path
from hmap_core.waypoints.search import Corners, MotionSpace, ObjectSearch, SpaceFactory, search_bounds
from hmap_core.waypoints.search_budget import SearchBudget

# rounds of a search that tests whether one body can stay in place
ROUNDS_PER_BODY = 1
# other paths that are tested for needing fewer removals
ALTERNATIVES = 3


@dataclass(frozen=True)
class Removal:
    """Bodies to move out of the way, and a path that is free without them."""

    names: tuple[str, ...]  # in the order in which the path hits them
    corners: Corners


def fewest_removals(
    problem: ObjectPathProblem,
    found: Corners,
    needed: frozenset[str],
    rng: np.random.Generator,
    budget: SearchBudget,
    make_space: SpaceFactory = MotionSpace,
) -> Removal:
    """Find bodies whose removal makes a path possible.

    A path through all removable bodies determines which of them it runs into. Each of these that can stay while the
    others are removed is found and stays. The rest belongs to one path. The search then keeps all of these bodies in
    place, then single ones, and looks for other paths; a path with fewer removals replaces the first. The exact
    minimum is NP-hard (Hauser, "The minimum constraint removal problem with three robotics applications", IJRR 2014).
    The number of searches is at most (2 + ALTERNATIVES) times the number of bodies.

    Args:
        problem: the problem with all its obstacles; it is known to have no path.
        found: a path that is free without the removable bodies.
        needed: removable bodies that overlap the object's goal pose.
        rng: the only source of randomness.
        budget: limit of the search; if it is exhausted, the best result so far is returned.
        make_space: makes the search in planar or spatial motion; detours are always found by hmap's own trees.

    Returns:
        The bodies to remove, and a path without them. As far as the searches can tell, none of the bodies can stay.
    """
    best = _RemovalSearch(problem, needed, rng, budget, make_space).search(found)
    checker = checker_like(best.corners, problem.without(frozenset(best.names)), budget.clock_deadline)
    return Removal(best.names, Corners(best.corners.poses, checker, best.corners.middle))


class _RemovalSearch:
    def __init__(self, problem, needed, rng, budget: SearchBudget, make_space: SpaceFactory):
        self.problem, self.needed, self.rng, self.budget = problem, needed, rng, budget
        self.make_space = make_space
        self.unavoidable = set(needed)  # bodies that every path needs to have removed

    def search(self, found: Corners) -> Removal:
        best = self._reduced(self._removal(found), np.inf)
        left = ALTERNATIVES
        sets_to_keep = self._sets_to_keep(best)
        while sets_to_keep and left and len(best.names) > max(1, len(self.unavoidable)) and not self.budget.exhausted:
            kept = sets_to_keep.pop(0)
            other = self._without(self.problem.removable - kept)
            if other is None:
                self.unavoidable |= kept if len(kept) == 1 else set()
                continue
            left -= 1
            other = self._reduced(other, len(best.names))
            if len(other.names) < len(best.names):
                best = other
                sets_to_keep = self._sets_to_keep(best)
        return best

    def _sets_to_keep(self, removal: Removal) -> list[frozenset[str]]:
        """Sets of bodies to keep in place in searches for another path."""
        names = [name for name in removal.names if name not in self.unavoidable]
        together = [frozenset(names)] if len(names) > 1 else []
        return together + [frozenset({name}) for name in names]

    def _reduced(self, removal: Removal, limit: float) -> Removal:
        """The removal without the bodies that can stay; stops once ``limit`` bodies or more have to be removed."""
        irreducible = set(self.unavoidable)
        while not self.budget.exhausted and len(irreducible) < limit:
            name = next((n for n in removal.names if n not in irreducible), None)
            if name is None or len(removal.names) == 1:
                break
            gone = frozenset(removal.names) - {name}
            fewer = self._detour(removal.corners, gone) or self._without(gone)
            if fewer is None:
                irreducible.add(name)
            else:
                removal = fewer
        return removal

    def _without(self, gone: frozenset[str]) -> Removal | None:
        """The path that a search with these bodies removed, and all others in place, finds."""
        search = ObjectSearch(self.problem.without(gone), self.make_space, deadline=self.budget.clock_deadline)
        corners = search.rounds(self.rng, self.budget, ROUNDS_PER_BODY)
        return None if corners is None else self._removal(corners)

    def _detour(self, corners: Corners, gone: frozenset[str]) -> Removal | None:
        """A short search for a detour around the obstacles that a path hits if only the bodies ``gone`` are removed."""
        checker = checker_like(corners, self.problem.without(gone), self.budget.clock_deadline)
        dense, _ = resample(corners.poses)
        free = np.array([checker.motion_free(a, b) for a, b in zip(dense[:-1], dense[1:], strict=True)])
        if free.all():
            return self._removal(Corners(dense, checker, corners.middle))
        first, last = int(np.argmin(free)), len(free) - int(np.argmin(free[::-1]))
        bounds = search_bounds(recentred(self.problem, corners.middle), checker)
        way = rrt_path(checker, [dense[first]], [dense[last]], bounds, self.rng, self.budget, rounds=ROUNDS[:1])
        if way is None:
            return None
        return self._removal(Corners(np.concatenate([dense[:first], way, dense[last + 1 :]]), checker, corners.middle))

    def _removal(self, corners: Corners) -> Removal:
        return Removal(removables_hit(self.problem, corners, self.needed), corners)


def removables_hit(problem: ObjectPathProblem, found: Corners, needed: frozenset[str]) -> tuple[str, ...]:
    """List the removable bodies that a path runs into.

    Args:
        problem: the problem with all its obstacles.
        found: the path.
        needed: removable bodies that overlap the goal pose; always part of the result.

    Returns:
        Names in the order in which the path runs into the bodies, then the ``needed`` ones.
    """
    checker = checker_like(found, problem)
    hit: list[str] = []
    for a, b in zip(found.poses[:-1], found.poses[1:], strict=True):
        hit += [name for name in checker.hit_by(a, b) if name in problem.removable]
    return tuple(dict.fromkeys([*hit, *sorted(needed)]))


def checker_like(found: Corners, problem: ObjectPathProblem, deadline: float = np.inf) -> ObjectChecker:
    """Make a checker for the obstacles of ``problem`` with the motion type, minimum distance and frame of a path.

    Args:
        found: the path.
        problem: with the obstacles.
        deadline: when its checks end, in seconds of ``clock.now``.
    """
    central = recentred(problem, found.middle)
    geometry = Geometry(central, deadline=deadline)
    return ObjectChecker(central, geometry, found.checker.planar, found.checker.min_distance)
