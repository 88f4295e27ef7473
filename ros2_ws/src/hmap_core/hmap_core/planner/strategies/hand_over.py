"""Hand-over: one robot passes the object to another one, without a placement in between."""

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, MotionError, PlannerError
from hmap_core.planner import steps
from hmap_core.planner.goals import goal_of_round
from hmap_core.planner.hand_over import contacts_of, meetings
from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet, grasp_sets
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.protocols import SharedQuery
from hmap_core.planner.tasks import PathTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 24  # meetings for which motions are planned
TRIED_FIRST = 6  # of these, before the object is pushed or placed anywhere
ROUNDS = 2  # of the outer loop in which a hand-over is tried


class HandOver:
    """A robot that grasps the object where it is passes it to one that can bring it to its goal.

    Args:
        first: whether it comes before slower strategies: with few meetings, if no robot has a grasp at both ends.
    """

    name = "hand-over"

    def __init__(self, first: bool = False):
        self._first = first

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical, about the task's own object, and several contacts may be used."""
        rounds = 1 if self._first else ROUNDS
        return task.subgoal.depth == 0 and task.number < rounds and task.may_change_contacts

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try meetings of each pair of robots."""
        context, record, object = search.context, search.context.record, task.object
        scene = context.scene
        if len(scene.robots) < 2 or scene.motion == "planar":
            return record.last_failure()
        sequence = steps.place_tool(context, task.sequence)
        if sequence is None:
            return record.last_failure()
        context.report("waypoints", text=f"hand-overs of '{object}'")
        goal, rng = goal_of_round(context, task, sequence.state), context.child_rng()
        ends = sequence.state.poses[object], goal.pose
        sets = grasp_sets(scene, sequence.state, object, ends, rng)
        if self._first:
            task.relay = self._relay(sets, ends, rng)
            if not task.relay:
                return record.last_failure()
        most = TRIED_FIRST if self._first else TRIED
        failure: Failure | None = None
        tries = 0
        for giver, taker in permutations(sets, 2):
            for meeting in meetings(scene, ends, giver, taker, rng):
                if tries == most:
                    break
                tries += 1
                context.report("motion", attempt=tries, text=f"{giver.robot} passes '{object}' to {taker.robot}")
                with record.tree.attempt(f"{giver.robot} passes '{object}' to {taker.robot}") as node:
                    try:
                        contacts = contacts_of(scene, sequence.state, object, meeting, goal.pose, rng)
                        query = SharedQuery(
                            scene,
                            sequence.state,
                            object,
                            contacts,
                            np.array([ends[0], meeting.T, goal.pose]),
                            context.seed(),
                            context.time_left(),
                            hand_over=True,
                        )
                        done = sequence.after(context.components.segments.plan_shared(query))
                    except MotionError as error:
                        node.fail(error.stage, error.code, error.reason)
                        failure = Failure.of(error)
                        continue
                    node.succeed()
                return Solution(done, waypoints=np.array([meeting.T, goal.pose]))
        nobody = PlannerError(f"no two robots can pass '{object}' on", Code.NO_CONTACT)
        return failure or Failure.of(record.error or nobody)

    @staticmethod
    def _relay(sets: list[GraspSet], ends: tuple[np.ndarray, np.ndarray], rng: np.random.Generator) -> bool:
        """Whether robots grasp the object at its start and at its goal, and none reaches one grasp at both."""
        both = [[bool(own.serves(T).any()) for own in sets] for T in ends]
        return all(any(some) for some in both) and not any(own.hands(*ends, 1, rng) for own in sets)
