"""The three phases of H-MaP, done by other nodes: what Algorithm 1 calls when it runs in the supervisor.

What has to do with taking a tool and putting it back is done in the supervisor's own process.
"""

from collections.abc import Sequence

import numpy as np

from hmap.conversions import cloud_to_message, scene_to_message, state_to_message
from hmap.phase_conversions import (
    contact_from_message,
    contact_to_message,
    feasible_contact,
    motion_from_response,
    path_from_response,
)
from hmap.requests import Caller
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import WaypointError
from hmap_core.planner import LocalBackend
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.types import ContactPoint, Goal, Scene, SceneState
from hmap_core.waypoints import NoObjectPath, ObjectPath
from hmap_msgs.srv import CheckContacts, PlanWaypoints, ProposeContacts, SolveSegment
from hmap_msgs_py.contacts import contact_to_message as candidate_to_message
from hmap_msgs_py.poses import pose_to_message, poses_to_messages

SHORTEST = 0.1  # s; a request with less time left gets this much
CHECK_LIMIT = 30.0  # s for a check of contacts of which nothing else is said
MAX_SEED = 2**31 - 1


class RosBackend(LocalBackend):
    """Implements :class:`hmap_core.planner.interfaces.Backend` by services, and for tools as its base class does."""

    def __init__(self, caller: Caller):
        super().__init__()
        self._caller = caller

    def plan_waypoints(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        goal: Goal,
        seed: int,
        time_limit: float,
        checks: float = np.inf,
    ) -> ObjectPath:
        request = PlanWaypoints.Request(object=object, goal=pose_to_message(goal.pose, "goal"))
        request.checks = int(checks) if np.isfinite(checks) else 0
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

    def check_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robot: str,
        contacts: Sequence[ContactPoint],
        rng: np.random.Generator,
        time_limit: float = CHECK_LIMIT,
    ) -> list[RobotContact]:
        if not contacts:
            return []
        request = CheckContacts.Request(
            object=object,
            contacts=[candidate_to_message(contact, robot, object) for contact in contacts],
            object_poses=poses_to_messages(object_poses),
        )
        seed = int(rng.integers(MAX_SEED))
        response = self._call(CheckContacts, "check_contacts", request, scene, state, seed, time_limit)
        results = zip(contacts, response.results, strict=True)
        return [feasible_contact(scene, robot, contact, result) for contact, result in results if result.feasible]

    def solve_segment(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        contact: RobotContact,
        object_poses: np.ndarray,
        seed: int,
        time_limit: float,
    ) -> SubTrajectory:
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
