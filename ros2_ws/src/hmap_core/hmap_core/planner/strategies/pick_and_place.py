"""Pick, transfer, place: the arm carries the object as a part of its hand, with no path of the object given."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.feasibility import reachable
from hmap_core.exceptions import MotionError
from hmap_core.planner.contact_checker import cleared
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import path_scene
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.outcome import Outcome, Solution
from hmap_core.planner.protocols import ToolQuery
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.strategies.remove_obstacles import removable_load
from hmap_core.planner.tasks import EndGrasp, PathTask
from hmap_core.types import ContactKind, Scene, SceneState

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 3  # grasps for which motions are planned
ROUNDS = 2  # of the outer loop in which it is tried


class PickAndPlace:
    """A transfer motion between grasps that serve at the start and at the goal (Alami, Siméon, Laumond, ISRR 1989).

    For objects whose path a hand could follow, but not the arm behind it: here, the search moves the joints.
    """

    name = "pick and place"

    def applies(self, task: PathTask) -> bool:
        """Whether there are grasps that serve at both ends, and the object may be lifted."""
        free = task.sequence.tool_grasp is None
        return bool(task.hands) and task.number < ROUNDS and not task.kinematic and free

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try the grasps, in the order in which they were found."""
        context, record = search.context, search.context.record
        planar = context.scene.motion == "planar" and task.subgoal.depth == 0
        if planar or removable_load(path_scene(context.scene, task), task):
            return record.last_failure()
        grasps = [own for own in task.hands if own.contact.kind == ContactKind.GRASP]
        for number, grasp in enumerate(grasps[:TRIED], 1):
            what = f"{grasp.robot} picks and places '{task.object}'"
            record.counts["contact_tries"] += 1
            context.report("motion", attempt=number, text=what)
            with record.tree.attempt(what) as node:
                try:
                    sequence = picked_and_placed(context, task.sequence, task.object, grasp)
                except MotionError as error:
                    record.failed(error)
                    node.fail(error.stage, error.code, error.reason)
                    continue
                node.succeed()
            return Solution(sequence, waypoints=np.array([grasp.T_goal]))
        return record.last_failure()


def picked_and_placed(
    context: SearchContext, sequence: SolutionSequence, object: str, grasp: EndGrasp
) -> SolutionSequence:
    """The sequence after a robot has picked and placed an object.

    Raises:
        MotionError: the robot does not reach the grasp at one end, or no motion was found.
    """
    scene, state = context.scene, sequence.state
    picked = _reached(context, scene, state, object, grasp, state.poses[object])
    placed = _reached(context, scene, state, object, grasp, grasp.T_goal)
    for contact, plan in (
        (picked, context.components.segments.plan_pick),
        (replace(placed, clear=()), context.components.segments.plan_place),
    ):
        own = ToolGrasp(object, contact, grasp.T_goal)
        query = ToolQuery(scene, sequence.state, own, context.seed(), context.time_left())
        sequence = sequence.after(plan(query))
    return sequence


def _reached(
    context: SearchContext, scene: Scene, state: SceneState, object: str, grasp: EndGrasp, T: np.ndarray
) -> RobotContact:
    """A grasp on the object at T (7,) with the configuration that reaches it. Raises MotionError."""
    there = state.copy()
    there.poses[object] = T
    manipulation, away = cleared(scene, there, object, grasp.robot)
    ok, q = reachable(manipulation, [grasp.contact], T, context.child_rng())
    if not ok[0]:
        place = ", ".join(f"{value:.3f}" for value in T[:3])
        raise MotionError(f"'{grasp.robot}' does not reach its grasp on '{object}' at ({place})")
    return RobotContact(grasp.robot, grasp.contact, 0, q, away)
