"""Whether a hand or a tool is tried first at a waypoint: by what a ranker expects of the hands."""

import numpy as np

from hmap_core.planner.robot_order import UNLIKELY
from hmap_core.planner.strategies import ATTACHED_FIRST, CONTACT_STRATEGIES, TOOL_FIRST
from hmap_core.planner.strategies.base import Strategy
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import tools_of, with_tool_placed


def contact_strategies(task: WaypointTask) -> tuple[Strategy, ...]:
    """The strategies for contacts at a waypoint, in the order in which they are tried."""
    ranker, scene = task.context.components.ranker, task.context.scene
    if ranker is None or not tools_of(scene, task.object):
        return CONTACT_STRATEGIES
    state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
    expected = ranker.hand_serves(scene, state, task.object, task.ahead, tuple(scene.robots))
    likely, grasp = float(np.max(expected, initial=0.0)), task.sequence.tool_grasp
    if grasp is not None:
        held, _ = ranker.hold_serves(scene, task.sequence.state, task.object, task.ahead, (grasp,))
        return ATTACHED_FIRST if held[0] > likely else CONTACT_STRATEGIES
    return TOOL_FIRST if likely < UNLIKELY else CONTACT_STRATEGIES
