"""Replanning during an execution, by the planner in this process."""

import numpy as np

from hmap_core import planner
from hmap_core.execution.attached_tool import AttachedTool
from hmap_core.execution.closed_loop import Replanner
from hmap_core.planner.tools import tool_grasp_of
from hmap_core.types import Plan, Scene, SceneState


def replanner(scene: Scene, seed: int, time_limit: float) -> Replanner:
    """Builds the replanning function for :func:`hmap_core.execution.closed_loop.execute_closed_loop`.

    Args:
        scene: the task, with its goal.
        seed: seed from which the seed of every new plan is derived.
        time_limit: wall-clock time for each plan, s.

    Returns:
        A function of the measured state, the number of the replan and the attached tools. It returns a plan, and raises
        the exceptions of :func:`hmap_core.planner.plan`.
    """

    def replan(state: SceneState, attempt: int, tools: tuple[AttachedTool, ...]) -> Plan:
        own = int(np.random.SeedSequence((seed, attempt)).generate_state(1)[0])
        tool_grasp = tool_grasp_of(tools[0]) if tools else None
        return planner.plan(scene, state, seed=own, time_limit=time_limit, tool_grasp=tool_grasp)

    return replan
