"""OMPL's planners as object-path planners, ``ompl:NAME``."""

from functools import partial

from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.waypoints.ompl_planner import plan_waypoints_ompl
from hmap_core.waypoints.ompl_solver import known_planner


def ompl_object_path(name: str = "") -> BidirectionalSearch:
    """An object-path planner that searches by a planner of OMPL.

    Args:
        name: class name of a geometric planner of OMPL, such as RRTConnect.

    Raises:
        InputError: OMPL is not installed, or has no such planner.
    """
    return BidirectionalSearch(partial(plan_waypoints_ompl, known_planner(name)))
