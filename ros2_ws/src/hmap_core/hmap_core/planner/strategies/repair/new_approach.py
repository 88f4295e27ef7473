"""Keep a subgoal, but plan the way to its first contact anew."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, MotionError
from hmap_core.planner import segments
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.planned_contacts import contact_of
from hmap_core.planner.strategies.repair.base import NOT_APPLICABLE, RepairTask
from hmap_core.planner.surroundings import away_from_home
from hmap_core.types import SceneState, Segment, Trajectory

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

REST = 3  # samples at rest in a contact, with which the judge sees a way to it


class NewApproach:
    """Another way to exactly the configuration in which the first contact was made."""

    name = "another way to its contact"
    kept = "work"

    def applies(self, task: RepairTask) -> bool:
        """Whether the contact is still ahead, objects are as planned, and all after the contact is free."""
        repair, subgoal, state = task.repair, task.subgoal, task.state
        if subgoal.begin < repair.at or not repair.objects_as_planned(subgoal, state):
            return False
        return repair.is_free(subgoal, state, subgoal.begin, subgoal.last)

    def solve(self, search: "Search", task: RepairTask) -> Outcome:
        """Plan the way and copy the rest."""
        repair, state, context = task.repair, task.state, search.context
        kept = task.subgoal.contacts[0]
        robot = kept.segment.robot
        q = repair.plan.trajectory.joints[robot][kept.begin]
        away = away_from_home(repair.scene, state, robot)
        contact = RobotContact(robot, contact_of(repair.plan, kept), 0, q[None], away)
        try:
            way = segments.come(
                repair.scene, state, contact, kept.segment.contact_object, context.child_rng(), repair.time_left()
            )
        except MotionError as error:
            return Failure.of(error)
        arrived = task.sequence.after(way)
        if not repair.robots_as_planned(arrived.state, task.subgoal.begin):
            return Failure("motion", Code.NO_MOTION, NOT_APPLICABLE)
        rest = _at_rest(arrived.state, kept.segment, repair.period)
        copied = repair.copied(task.subgoal, task.subgoal.begin)
        return Solution(arrived.after(copied), unjudged=((state, (way, rest)),))


def _at_rest(state: SceneState, contact: Segment, period: float) -> SubTrajectory:
    """A moment of rest in a contact, in the state in which it was made."""
    time = period * np.arange(REST)
    trajectory = Trajectory(
        time,
        {contact.robot: np.tile(state.q[contact.robot], (REST, 1))},
        {contact.robot: np.full(REST, state.gripper[contact.robot])},
        {contact.contact_object: np.tile(state.poses[contact.contact_object], (REST, 1))},
    )
    return SubTrajectory(trajectory, (replace(contact, start=0.0, end=float(time[-1])),))
