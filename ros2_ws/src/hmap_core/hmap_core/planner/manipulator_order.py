"""Whether a hand or a tool is tried first at a waypoint: by what a ranker expects of the hands."""

import numpy as np

from hmap_core.planner.strategies import CONTACT_STRATEGIES, TOOL_FIRST
from hmap_core.planner.strategies.base import Strategy
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import tools_of, with_tool_placed

UNLIKELY = 0.1  # probability that a hand serves more than a few poses, below which tools are tried first


def contact_strategies(task: WaypointTask) -> tuple[Strategy, ...]:
    """The strategies for contacts at a waypoint, in the order in which they are tried."""
    ranker, scene = task.context.components.ranker, task.context.scene
    if ranker is None or not tools_of(scene, task.object):
        return CONTACT_STRATEGIES
    state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
    expected = ranker.hand_serves(scene, state, task.object, task.ahead, tuple(scene.robots))
    return TOOL_FIRST if len(expected) and float(np.max(expected)) < UNLIKELY else CONTACT_STRATEGIES
