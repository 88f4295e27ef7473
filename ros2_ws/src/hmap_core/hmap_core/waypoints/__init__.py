"""Algorithm 2: the path of the object alone, cut into waypoints."""

from hmap_core.waypoints.grounded import slid_first
from hmap_core.waypoints.plan import DEFAULT_TIME_LIMIT, plan_waypoints
from hmap_core.waypoints.problem import DEFAULT_MIN_DISTANCE, NoObjectPath, ObjectPath, ObjectPathProblem
from hmap_core.waypoints.shorten import smooth
from hmap_core.waypoints.standing import standing

__all__ = [
    "DEFAULT_MIN_DISTANCE",
    "DEFAULT_TIME_LIMIT",
    "NoObjectPath",
    "ObjectPath",
    "ObjectPathProblem",
    "plan_waypoints",
    "slid_first",
    "smooth",
    "standing",
]
