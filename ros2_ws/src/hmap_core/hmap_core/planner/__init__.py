"""Algorithm 1: waypoints, contacts and motions put together into a plan."""

from hmap_core.planner.algorithm import DEFAULT_TIME_LIMIT, J_MAX, Planner, plan
from hmap_core.planner.free_motion import plan_motion
from hmap_core.planner.interfaces import Backend, Progress, RobotContact, SubTrajectory
from hmap_core.planner.local import LocalBackend

__all__ = [
    "DEFAULT_TIME_LIMIT",
    "J_MAX",
    "Backend",
    "LocalBackend",
    "Planner",
    "Progress",
    "RobotContact",
    "SubTrajectory",
    "plan",
    "plan_motion",
]
