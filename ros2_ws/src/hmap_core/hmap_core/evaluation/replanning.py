"""Replanning during an execution, by the planner in this process."""

import numpy as np

from hmap_core import planner
from hmap_core.execution.recovery import Replanner, ReplanRequest
from hmap_core.planner.repair import plan_anew
from hmap_core.types import Plan


def replanner(seed: int, time_limit: float) -> Replanner:
    """Builds the replanning function for :class:`hmap_core.execution.plan_executor.PlanExecutor`.

    Args:
        seed: seed from which the seed of every new plan is derived.
        time_limit: wall-clock time for each plan, s.

    Returns:
        A function of a request. It returns a plan, and raises the exceptions of :func:`hmap_core.planner.plan`.
    """

    def replan(request: ReplanRequest) -> Plan:
        own = int(np.random.SeedSequence((seed, request.attempt)).generate_state(1)[0])
        if request.blocked is not None:
            return plan_anew(*request.blocked, request.scene, request.state, own, time_limit=time_limit)[0]
        tool_grasp = request.tools[0] if request.tools else None
        return planner.plan(request.scene, request.state, seed=own, time_limit=time_limit, tool_grasp=tool_grasp)

    return replan
