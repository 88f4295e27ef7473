"""The node ``waypoint_planner``: the path of an object on its own (Algorithm 2), as a service."""

import sys
from dataclasses import replace

import numpy as np

from hmap.conversions import known_object
from hmap.lifecycle import ManagedNode
from hmap.node import run
from hmap.phase_conversions import path_to_response
from hmap.requests import scene_and_state, time_limit
from hmap_core.planner import ObjectPathQuery, plugins
from hmap_core.waypoints import NoObjectPath
from hmap_msgs.srv import PlanWaypoints
from hmap_msgs_py.errors import error_to_message
from hmap_msgs_py.poses import pose_from_message


class WaypointPlanner(ManagedNode):
    """Serves ``plan_waypoints``.

    Attributes:
        planner: plans the paths.
    """

    plans = True

    def __init__(self):
        super().__init__("waypoint_planner")
        self._time_limit = self.parameter("time_limit", 10.0, "s, of a request that names none", 0.01, 3600.0)
        name = self.parameter("object_path_planner", "hmap", "plans the paths; see `hmap plugins`")
        self.planner = plugins.create(plugins.OBJECT_PATH_PLANNERS, name)
        self.serve(PlanWaypoints, "plan_waypoints", self._plan)

    def _plan(self, request: PlanWaypoints.Request, response: PlanWaypoints.Response) -> None:
        scene, state = scene_and_state(request, self.get_logger().warning)
        name = known_object(scene, request.object)
        goal = replace(scene.goal, object=name, pose=pose_from_message(request.goal, "goal"))
        limit = time_limit(request, self._time_limit)
        checks = float(request.checks or np.inf)
        try:
            path = self.planner.plan_path(ObjectPathQuery(scene, state, goal, int(request.seed), limit, checks))
        except NoObjectPath as error:
            response.error = error_to_message(error)
            response.blocking = list(error.blockers)
            response.removal_known = error.free_without is not None
            response.free_without = list(error.free_without or ())
            if error.path_without is not None:
                path_to_response(error.path_without, name, response)
            return
        path_to_response(path, name, response)


def main(args: list[str] | None = None) -> int:
    """Run the node; its exit code."""
    return run(WaypointPlanner, args)


if __name__ == "__main__":
    sys.exit(main())
