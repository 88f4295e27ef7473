"""Contact finders that wrap another one: predicate filters, cost terms, and contacts that are known already."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.exceptions import Code, ContactError
from hmap_core.planner.interfaces import AttachedPath, RobotContact, ToolGrasp
from hmap_core.planner.obstruction import HAND_MIN_DISTANCE
from hmap_core.planner.protocols import ContactChecker, ContactFinder, ContactQuery, ContactSearchQuery
from hmap_core.planner.relaxed import RelaxedSolution
from hmap_core.planner.surroundings import away_from_home
from hmap_core.planner.sweep import nearest, placed, robot_sweeps
from hmap_core.planner.tool_grasps import ToolGraspFinder
from hmap_core.types import Scene, SceneState


class NoneServes(ContactError):
    """There are feasible contacts, and none of them is what was asked for."""


Predicate = Callable[[ContactSearchQuery, RobotContact], bool]
Cost = Callable[[ContactSearchQuery, RobotContact], float]


class PredicateFilter:
    """Keeps the contacts for which a predicate holds.

    Args:
        finder: finds the contacts.
        predicate: of the query and a contact.
        requirement: what it asks for, to complete "none of the contacts ...".
    """

    def __init__(self, finder: ContactFinder, predicate: Predicate, requirement: str):
        self._finder, self._predicate, self._requirement = finder, predicate, requirement

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """Find contacts for which the predicate holds.

        Raises:
            ContactError: NO_CONTACT; there are none at all.
            NoneServes: the predicate holds for none.
        """
        contacts = self._finder.find_contacts(query)
        kept = [contact for contact in contacts if self._predicate(query, contact)]
        if not kept:
            raise NoneServes(f"none of {len(contacts)} contacts {self._requirement}", Code.NO_CONTACT)
        return kept


class CostTerm:
    """Sorts contacts by a cost, the lowest first; equal costs keep their order.

    Args:
        finder: finds the contacts.
        cost: of the query and a contact.
    """

    def __init__(self, finder: ContactFinder, cost: Cost):
        self._finder, self._cost = finder, cost

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """As :meth:`hmap_core.planner.protocols.ContactFinder.find_contacts`."""
        return sorted(self._finder.find_contacts(query), key=lambda contact: self._cost(query, contact))


def covers_path(query: ContactSearchQuery, contact: RobotContact) -> bool:
    """Predicate: the contact serves to the end of the object's path."""
    return contact.reach == len(query.object_poses) - 1


def covering(finder: ContactFinder, object: str) -> PredicateFilter:
    """A finder of contacts that carry an object all the way."""
    return PredicateFilter(finder, covers_path, f"carries '{object}' all the way")


def bodies_hit(scene: Scene, names: Sequence[str]) -> Cost:
    """Cost: the number of some bodies of a scene that the robot is in the way of, over all poses of the contact."""

    def cost(query: ContactSearchQuery, contact: RobotContact) -> float:
        openings = np.full(len(contact.keyframes), contact.contact.opening)
        sweeps = robot_sweeps(query.scene.robots[contact.robot], contact.keyframes, openings)
        return len(nearest(sweeps, placed(scene, query.state, names), HAND_MIN_DISTANCE))

    return cost


class KnownContact:
    """Returns a contact that is known to work once, for the poses for which it is known; then it searches.

    Args:
        finder: searches.
        known: solution of the relaxed problem.
        poses: (M, 7) poses of the object for which it was found.
    """

    def __init__(self, finder: ContactFinder, known: RelaxedSolution, poses: np.ndarray):
        self._finder, self._contact, self._poses = finder, known.contact, poses

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """As :meth:`hmap_core.planner.protocols.ContactFinder.find_contacts`."""
        known, self._contact = self._contact, None
        if known is None or not np.array_equal(query.object_poses, self._poses):
            return self._finder.find_contacts(query)
        return [replace(known, clear=away_from_home(query.scene, query.state, known.robot))]


class KnownToolGrasp:
    """Returns a grasp on a tool that is known to work once, if the tool stands where it did; then it searches."""

    def __init__(self, finder: ToolGraspFinder, known: RelaxedSolution):
        self._finder, self._grasp = finder, known.tool_grasp

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float,
        likely: float = 0.0,
    ) -> list[tuple[ToolGrasp, int]]:  # fmt: skip
        """As :meth:`hmap_core.planner.tool_grasps.ToolGraspFinder.tool_grasps`."""
        known, self._grasp = self._grasp, None
        if known is None or not np.array_equal(state.poses[known.tool], known.T_place):
            return self._finder.tool_grasps(scene, state, object, object_poses, seed, time_limit, likely)
        return [(known, len(object_poses) - 1)]


class AttachedPathContact:
    """Returns the contact for which a path of object and hand was planned, once for each path that it covers.

    Args:
        checker: checks it.
        path: the path.
    """

    def __init__(self, checker: ContactChecker, path: AttachedPath):
        self._checker, self._path = checker, path
        self._returned: set[bytes] = set()

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """Return the contact of the path.

        Raises:
            NoneServes: it does not cover the path, or it was returned before.
        """
        path, poses, key = self._path, query.object_poses, query.object_poses.tobytes()
        found: list[RobotContact] = []
        if key not in self._returned:
            self._returned.add(key)
            own = ContactQuery(query.scene, query.state, query.object, poses, path.robot, np.random.default_rng(0))
            found = self._checker.check(own, [path.contact])
        found = [contact for contact in found if covers_path(query, contact)]
        if not found:
            raise NoneServes(f"the hand of '{path.robot}' does not carry '{query.object}' all the way", Code.NO_CONTACT)
        return found


class NoToolGrasps:
    """Returns no grasps: no tool may be picked."""

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float,
        likely: float = 0.0,
    ) -> list[tuple[ToolGrasp, int]]:  # fmt: skip
        """None."""
        return []
