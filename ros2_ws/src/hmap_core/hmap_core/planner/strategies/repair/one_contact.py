"""Achieve a subgoal in one contact: on the old path of its object, or on another one."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, HmapError
from hmap_core.planner.attached_path import attached_paths
from hmap_core.planner.contact_finder import contact_score
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.obstacle_removal import raise_if_final
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.planned_contacts import PlannedContact, contact_of
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.strategies.repair.base import RepairTask
from hmap_core.planner.surroundings import nearest_first
from hmap_core.types import ContactPoint, Goal, SceneState, SegmentKind

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

ATTACHED_CHECKS = 500  # motions checked for a path of an object with a hand attached; most that are found need none
PATH_CHECKS = 20_000  # motions checked for another path of an object; those that are found need fewer than 1000
HELD = (SegmentKind.GRASP, SegmentKind.TOUCH)  # contacts with which a hand carries an object anywhere
CONTACTS = 2  # searched, and tried, on a path


class OneContact:
    """One contact all the way: other contacts on the old path, paths for a hand, other paths of the object."""

    name = "in one contact"
    kept = "paths"

    def applies(self, task: RepairTask) -> bool:
        """Always."""
        return True

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Try the old path first if it is free, else paths for a hand; then other paths."""
        context, repair = search.context, task.repair
        goal, old = repair.goal_of(task.subgoal), task.old_path()
        if old is None:
            found = self._with_a_hand(context, task, goal)
            if found is not None:
                return found
        others = (path for motion in self._motions(task) for path in self._other_path(context, task, goal, motion))
        for poses in others if old is None else chain([old[1]], others):
            known = None if old is not None and poses is old[1] else task.subgoal.only_contact  # that has been tried
            for contact in self._contacts(context, task, known, goal.object, poses):
                found = self._solved(task, goal.object, contact, poses)
                if found is not None:
                    return found
        return Failure("contacts", Code.NO_CONTACT, f"no single contact brings '{goal.object}' to its goal")

    def _with_a_hand(self, context: SearchContext, task: RepairTask, goal: Goal) -> Solution | None:
        """Along a path for the object and a hand: that of the old contact, or others."""
        repair, state, name = task.repair, task.state, goal.object
        hands = self._hands(context, task, goal)
        planner, rng = context.components.object_path, context.child_rng()
        for path in attached_paths(planner, repair.scene, state, goal, hands, rng, repair.time_left(), ATTACHED_CHECKS):
            if path.blockers:
                continue
            query = context.contact_query(repair.scene, state, name, path.poses, path.robot, context.child_rng())
            for contact in context.components.checker.check(query, [path.contact]):
                if contact.reach == len(path.poses) - 1:
                    found = self._solved(task, name, contact, path.poses)
                    if found is not None:
                        return found
        return None

    def _hands(self, context: SearchContext, task: RepairTask, goal: Goal) -> Iterator[tuple[str, ContactPoint]]:
        """Robots and contacts that might hold the object all the way; the old one first."""
        repair, state, kept = task.repair, task.state, task.subgoal.only_contact
        if kept is not None and kept.segment.kind in HELD and not repair.by_tool(kept):
            yield kept.segment.robot, contact_of(repair.plan, kept)
        for robot in nearest_first(repair.scene, goal.object, state, tuple(repair.scene.robots)):
            for contact in context.components.end_contacts.find(
                repair.scene, state, goal.object, goal.pose, robot, CONTACTS, context.seed()
            ):
                yield robot, contact

    def _motions(self, task: RepairTask) -> tuple[str, ...]:
        """How an object may move; if that is open, lifted first, where there is more room."""
        motion = task.repair.scene.motion
        return ("spatial", "planar") if motion == "auto" else (motion,)

    def _other_path(self, context: SearchContext, task: RepairTask, goal: Goal, motion: str) -> list[np.ndarray]:
        """A path (M, 7) of an object to its goal, if there is one."""
        repair = task.repair
        scene = replace(repair.scene, motion=motion)
        query = ObjectPathQuery(scene, task.state, goal, context.seed(), repair.time_left(), PATH_CHECKS)
        try:
            return [context.components.object_path.plan_path(query).poses]
        except HmapError as error:
            raise_if_final(error)
            return []

    def _contacts(
        self, context: SearchContext, task: RepairTask, kept: PlannedContact | None, name: str, poses: np.ndarray
    ) -> list[RobotContact]:
        """Contacts that carry an object along all of its poses (M, 7): the old one if it does, else others."""
        repair, state, parts, last = task.repair, task.state, context.components, len(poses) - 1
        if kept is not None and not repair.by_tool(kept):
            robot, known = kept.segment.robot, [contact_of(repair.plan, kept)]
            query = context.contact_query(repair.scene, state, name, poses, robot, context.child_rng())
            found = parts.checker.check(query, known)
            if found and found[0].reach == last:
                return found
        for robot in nearest_first(repair.scene, name, state, tuple(repair.scene.robots)):
            query = context.contact_query(repair.scene, state, name, poses, robot, context.child_rng())
            for batch in parts.proposer.propose(query):
                found = parts.checker.check(query, batch.contacts, last - 1)
                if found or repair.time_left() < 0.0:
                    return sorted(found, key=lambda contact: -contact_score(repair.scene, contact))[:CONTACTS]
        return []

    def _solved(self, task: RepairTask, name: str, contact: RobotContact, poses: np.ndarray) -> Solution | None:
        state: SceneState = task.state
        found = task.repair.motion(state, name, contact, poses)
        return None if found is None else Solution(task.sequence.after(found), unjudged=((state, (found,)),))
