"""The three phases of H-MaP, done by other nodes: what Algorithm 1 calls when it runs in the supervisor."""

from collections.abc import Sequence

import numpy as np

from hmap.conversions import (
    cloud_to_message,
    contact_from_message,
    contact_to_message,
    motion_from_response,
    path_from_response,
    scene_to_message,
    state_to_message,
)
from hmap.requests import Caller
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import WaypointError
from hmap_core.planner.interfaces import RobotContact, SegmentMotion
from hmap_core.types import Goal, Scene, SceneState
from hmap_core.waypoints import NoObjectPath, ObjectPath
from hmap_msgs.srv import PlanWaypoints, ProposeContacts, SolveSegment
from hmap_msgs_py.poses import pose_to_message, poses_to_messages

SHORTEST = 0.1  # s; a request with less time left gets this much


class RosBackend:
    """Implements :class:`hmap_core.planner.interfaces.Backend` by services."""

    def __init__(self, caller: Caller):
        self._caller = caller

    def plan_waypoints(
        self, scene: Scene, state: SceneState, object: str, goal: Goal, seed: int, time_limit: float
    ) -> ObjectPath:
        request = PlanWaypoints.Request(object=object, goal=pose_to_message(goal.pose, "goal"))
        try:
            response = self._call(PlanWaypoints, "plan_waypoints", request, scene, state, seed, time_limit)
        except WaypointError as error:
            response = getattr(error, "response", None)
            if response is None:
                raise
            without = tuple(response.free_without) if response.removal_known else None
            path = path_from_response(response) if response.path.poses else None
            raise NoObjectPath(error.reason, tuple(response.blocking), without, path) from None
        return path_from_response(response)

    def propose_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robots: Sequence[str],
        cloud: Cloud | None,
        count: int,
        seed: int,
        time_limit: float,
    ) -> list[RobotContact]:
        request = ProposeContacts.Request(
            object=object, robots=list(robots), object_poses=poses_to_messages(object_poses), count=int(count)
        )
        if cloud is not None:
            request.cloud = cloud_to_message(object, state.poses[object], cloud)
        response = self._call(ProposeContacts, "propose_contacts", request, scene, state, seed, time_limit)
        return [contact_from_message(scene, message) for message in response.contacts]

    def solve_segment(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        contact: RobotContact,
        object_poses: np.ndarray,
        seed: int,
        time_limit: float,
    ) -> SegmentMotion:
        request = SolveSegment.Request(
            object=object,
            robot=contact.robot,
            contact=contact_to_message(contact, object),
            object_poses=poses_to_messages(object_poses),
        )
        response = self._call(SolveSegment, "solve_segment", request, scene, state, seed, time_limit)
        return motion_from_response(scene, response)

    def _call(self, service: type, name: str, request, scene: Scene, state: SceneState, seed: int, limit: float):
        request.scene = scene_to_message(scene)
        request.world = state_to_message(scene, state)
        request.seed = int(seed)
        request.time_limit = max(SHORTEST, float(limit))
        return self._caller.call(service, name, request, request.time_limit)
