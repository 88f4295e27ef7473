"""Pairs of grasps are tried one after the other, until two robots carry the object to its goal together."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, ContactError, MotionError, PlannerError
from hmap_core.planner import steps
from hmap_core.planner.attached_path import path_with_hands
from hmap_core.planner.goals import goal_of_round
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.lifting import raised_at_ends
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.protocols import SharedQuery
from hmap_core.planner.shared_grasps import GraspPair, SharedGrasps
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.surroundings import away_from_home
from hmap_core.planner.tasks import PathTask
from hmap_core.types import Goal, Scene

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 8  # pairs of grasps for which a path is planned


def possible(scene: Scene) -> bool:
    """Whether two robots of a scene have grippers, and its object may leave its support."""
    return scene.motion != "planar" and sum(robot.model.gripper is not None for robot in scene.robots.values()) > 1


@dataclass(frozen=True)
class TwoArms:
    """Two robots that may carry the object of a task together.

    Attributes:
        search, task: the job, and the round of the outer loop.
        sequence: what has been done already; all hands are free.
        goal: of the object.
        grasps: of the robots on the object.
    """

    search: "Search"
    task: PathTask
    sequence: SolutionSequence
    goal: Goal
    grasps: SharedGrasps

    @staticmethod
    def of(search: "Search", task: PathTask) -> "TwoArms | None":
        """The robots with their grasps; None where a tool cannot be placed."""
        context, object = search.context, task.object
        sequence = steps.place_tool(context, task.sequence)
        if sequence is None:
            return None
        context.report("waypoints", text=f"'{object}' by two arms")
        goal = goal_of_round(context, task, sequence.state)
        ends = sequence.state.poses[object], goal.pose
        grasps = SharedGrasps(context.scene, sequence.state, object, ends, context.child_rng())
        return TwoArms(search, task, sequence, goal, grasps)

    def solve(self) -> Outcome:
        """Try pairs of grasps; the failure is that of the last pair."""
        context, object = self.search.context, self.task.object
        if not self.grasps.promising():
            reason = f"two robots cannot carry '{object}' together: {self.grasps.why_none()}"
            return Failure.of(ContactError(reason, Code.NO_CONTACT))
        failure = Failure.of(
            PlannerError(f"two arms do not reach their grasps on '{object}' at start and goal", Code.NO_CONTACT)
        )
        for number, pair in zip(range(1, TRIED + 1), self.grasps.pairs(), strict=False):
            what = f"{pair.robots[0]} and {pair.robots[1]} carry '{object}'"
            context.report("motion", attempt=number, text=what)
            with context.record.tree.attempt(f"{what}, {100.0 * pair.share:.0f} % by {pair.robots[0]}") as node:
                try:
                    motion = self._motion(pair)
                except MotionError as error:
                    node.fail(error.stage, error.code, error.reason)
                    failure = Failure.of(error)
                    continue
                node.succeed()
            return Solution(self.sequence.after(motion), waypoints=np.array([self.goal.pose]))
        return failure

    def _motion(self, pair: GraspPair) -> SubTrajectory:
        """The motion with one pair of grasps. Raises MotionError."""
        context, state = self.search.context, self.sequence.state
        poses = self._path(pair)
        first, second = self.grasps.followed(pair, poses)
        first = replace(first, clear=away_from_home(context.scene, state, first.robot))
        context.record.counts["contact_tries"] += 1
        query = SharedQuery(
            context.scene, state, self.task.object, (first, second), poses, context.seed(), context.time_left()
        )
        return context.components.segments.plan_shared(query)

    def _path(self, pair: GraspPair) -> np.ndarray:
        """Path (M, 7) of the object with both hands attached; it leaves and reaches supports vertically.

        Raises:
            MotionError: there is none.
        """
        context, hands = self.search.context, list(zip(pair.robots, pair.contacts, strict=True))
        planner = context.components.object_path
        found = path_with_hands(
            planner, context.scene, self.sequence.state, self.goal, hands, context.rng, context.time_left()
        )
        if found is None or found[1]:
            around = f": {', '.join(found[1])} in the way" if found else ""
            raise MotionError(f"no path of '{self.goal.object}' with two hands attached{around}")
        context.record.counts["waypoint_plans"] += 1
        return raised_at_ends(found[0])
