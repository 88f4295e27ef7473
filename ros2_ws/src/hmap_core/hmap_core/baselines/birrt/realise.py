"""From the legs of a way to motions: transits, approaches and retreats are planned, and each leg is timed."""

import numpy as np

from hmap_core.baselines.birrt.search import Leg
from hmap_core.exceptions import Code, MotionError
from hmap_core.planner import steps
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import SegmentQuery
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.surroundings import away_from_home


class Realisation:
    """The motions of one way.

    Args:
        context: of the job.
        object: name of the object.

    Attributes:
        done: number of legs for which there are motions.
    """

    def __init__(self, context: SearchContext, object: str):
        self._context, self._object = context, object
        self.done = 0

    def solution(self, legs: list[Leg]) -> Solution:
        """The motions along the legs. Raises MotionError where there is none; PlannerError where the time is up."""
        sequence, self.done = SolutionSequence(self._context.start), 0
        for leg in legs:
            sequence = self._after(self._with_hand(sequence, leg), leg)
            self.done += 1
        placed = steps.place_tool(self._context, sequence)
        if placed is None:
            raise MotionError(self._context.record.reason, Code.NO_MOTION)
        return Solution(placed, waypoints=np.array([leg.poses[-1] for leg in legs]))

    def _with_hand(self, sequence: SolutionSequence, leg: Leg) -> SolutionSequence:
        """The sequence after which the hand of a leg is ready: its tool grasped, all others placed."""
        grasp = leg.mode.hand.grasp
        if grasp is sequence.tool_grasp:
            return sequence
        placed = steps.place_tool(self._context, sequence)
        if placed is None:
            raise MotionError(self._context.record.reason, Code.NO_MOTION)
        return placed if grasp is None else steps.pick_tool(self._context, placed, grasp)

    def _after(self, sequence: SolutionSequence, leg: Leg) -> SolutionSequence:
        hand, context = leg.mode.hand, self._context
        context.record.counts["contact_tries"] += 1
        context.report("motion", text=f"{hand.robot} moves '{self._object}' by {leg.mode.contact.kind}")
        away = away_from_home(hand.scene, sequence.state, hand.robot)
        contact = RobotContact(hand.robot, leg.mode.contact, len(leg.path) - 1, leg.path, away)
        query = SegmentQuery(
            hand.scene, sequence.state, self._object, contact, leg.poses, context.seed(), context.time_left()
        )
        return sequence.after(context.components.segments.plan_segment(query))
