"""What all baselines share: the task is checked as for H-MaP, and the judge has the last word."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner.components import PlannerComponents, local_components
from hmap_core.planner.context import SearchContext
from hmap_core.planner.hmap_planner import HmapPlanner, PlanningJob
from hmap_core.planner.interfaces import ProgressCallback
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.types import Goal, Plan, Scene, SceneState

# Moves one object to its goal from where the context starts; raises HmapError where it cannot.
Method = Callable[[SearchContext, Goal], Solution]


def solve(
    method: Method,
    scene: Scene,
    state: SceneState | None,
    seed: int,
    time_limit: float,
    progress: ProgressCallback | None,
    cancel: Cancel | None,
    components: PlannerComponents | None = None,
    removals_first: bool = True,
) -> Plan:
    """Plan a task by a method, again and again until the judge accepts a plan.

    Args:
        method: finds a solution of the task, another one at each call.
        scene, state, seed, time_limit, progress, cancel: of :meth:`ManipulationPlanner.plan`.
        components: hmap's parts that the method uses.
        removals_first: the removable bodies whose removal pose the task gives are moved there first, by the method.

    Raises:
        PlannerError: TIME_LIMIT or CANCELED; PLAN_REJECTED, the judge accepted none of the plans within the time.
        HmapError: another failure, with stage, code and reason.
    """
    planner = HmapPlanner(components or local_components())
    job = PlanningJob(planner, scene, state, seed, time_limit, progress, cancel)
    try:
        goal = job.checked_goal()
        while True:
            plan = job.accepted(_in_order(method, job.context, goal, removals_first))
            if plan is not None:
                return plan
            job.context.time_left()
    except HmapError as error:
        error.search = job.context.record.tree.root.to_dict()
        if error.code is Code.TIME_LIMIT and job.context.record.code is Code.PLAN_REJECTED:
            raise PlannerError(error.reason, Code.PLAN_REJECTED) from error
        raise


def _in_order(method: Method, context: SearchContext, goal: Goal, removals_first: bool) -> Solution:
    """The removable bodies whose removal pose the task gives, one after the other; then the object."""
    sequence, waypoints = SolutionSequence(context.start), np.zeros((0, 7))
    if not removals_first:
        return method(context, goal)
    removals = [Goal(name, T) for name, T in context.scene.removable.items() if T is not None and name != goal.object]
    for own in (*removals, goal):
        scene = context.scene if own is goal else replace(context.scene, motion="auto", goal=own)
        solution = method(replace(context, scene=scene, start=sequence.state), own)
        motions = (*sequence.motions, *solution.sequence.motions)
        aside = sequence.aside if own is goal else (*sequence.aside, own.object)
        sequence = SolutionSequence(solution.sequence.state, motions, aside, min(1, len(aside)))
        waypoints = solution.waypoints
    return Solution(sequence, waypoints=waypoints)
