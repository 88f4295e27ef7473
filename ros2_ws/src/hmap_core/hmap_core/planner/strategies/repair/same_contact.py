"""Keep contact and object path of a subgoal, from where the object stands now."""

from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.planned_contacts import contact_of
from hmap_core.planner.strategies.repair.base import NOT_APPLICABLE, RepairTask
from hmap_core.planner.surroundings import away_from_home

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


class SameContact:
    """The arm goes another way round, or makes the contact again that it had to release."""

    name = "with its contact, along its path"
    kept = "contacts"

    def applies(self, task: RepairTask) -> bool:
        """Whether it is by hand and in one contact."""
        contact = task.subgoal.only_contact
        return contact is not None and not task.repair.by_tool(contact)

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Plan the motion of the arm, if the rigid hand can still follow the path."""
        repair, state, context, old = task.repair, task.state, search.context, task.old_path()
        if old is None:
            return Failure("motion", Code.NO_MOTION, NOT_APPLICABLE)
        samples, poses = old
        kept = task.subgoal.contacts[0]
        robot, name = kept.segment.robot, kept.segment.contact_object
        q, away = repair.plan.trajectory.joints[robot][samples], away_from_home(repair.scene, state, robot)
        contact = RobotContact(robot, contact_of(repair.plan, kept), len(poses) - 1, q, away)
        query = context.contact_query(repair.scene, state, name, poses, robot, np.random.default_rng(0))
        if not context.components.checker.promising(query, [contact.contact], len(poses) - 2):
            return Failure("contacts", Code.NO_CONTACT, "the hand cannot follow the path any more")
        found = repair.motion(state, name, contact, poses)
        if found is None:
            return Failure("motion", Code.NO_MOTION, "the arm finds no motion with the old contact")
        return Solution(task.sequence.after(found), unjudged=((state, (found,)),))
