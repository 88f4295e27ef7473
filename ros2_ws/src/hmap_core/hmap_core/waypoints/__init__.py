"""Algorithm 2: the path of the object without a robot, and its waypoints."""

from hmap_core.waypoints.plan import DEFAULT_TIME_LIMIT, plan_waypoints
from hmap_core.waypoints.problem import DEFAULT_MIN_DISTANCE, NoObjectPath, ObjectPath, ObjectPathProblem
from hmap_core.waypoints.shorten import smooth
from hmap_core.waypoints.slide_then_lift import slide_then_lift
from hmap_core.waypoints.stable_poses import stable_poses

__all__ = [
    "DEFAULT_MIN_DISTANCE",
    "DEFAULT_TIME_LIMIT",
    "NoObjectPath",
    "ObjectPath",
    "ObjectPathProblem",
    "plan_waypoints",
    "slide_then_lift",
    "smooth",
    "stable_poses",
]
