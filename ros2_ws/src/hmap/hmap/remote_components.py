"""The parts of a planning job that other nodes do: the protocols of the planner, implemented by services."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hmap.conversions import cloud_to_message, placement_to_message, scene_to_message
from hmap.phase_conversions import (
    contact_from_message,
    contact_to_message,
    feasible_contact,
    motion_from_response,
    path_from_response,
)
from hmap.requests import Caller, error_from_message
from hmap_core.exceptions import WaypointError
from hmap_core.planner import (
    ContactProposer,
    ContactQuery,
    ContactSearchQuery,
    ObjectPathQuery,
    PlannerComponents,
    RobotContact,
    SegmentQuery,
    SharedQuery,
    SubTrajectory,
    ToolQuery,
    local_components,
)
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.types import ContactPoint, Scene, SceneState
from hmap_core.waypoints import NoObjectPath, ObjectPath
from hmap_msgs.msg import ErrorCode
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs.srv import CheckContacts, PlanWaypoints, ProposeContacts, SolveSegment
from hmap_msgs_py.contacts import contact_to_message as candidate_to_message
from hmap_msgs_py.poses import pose_to_message, poses_to_messages

SHORTEST = 0.1  # s; a request with less time left gets this much
CHECK_LIMIT = 30.0  # s for a check of contacts
MAX_SEED = 2**31 - 1


def remote_components(caller: Caller, proposer: ContactProposer | None = None) -> PlannerComponents:
    """The components of a job whose phases other nodes do; tools are chosen, picked and placed in this process.

    Args:
        caller: calls the services.
        proposer: if it is a ranker, it orders robots, tools and holds; contacts are those of `contact_proposer`.
    """
    return local_components(
        RosObjectPathPlanner(caller),
        proposer,
        checker=RosContactChecker(caller),
        contacts=RosContactFinder(caller),
        segments=RosSegmentPlanner(caller),
    )


class RosObjectPathPlanner:
    """Implements :class:`hmap_core.planner.protocols.ObjectPathPlanner` by the service ``plan_waypoints``."""

    def __init__(self, caller: Caller):
        self._caller = caller

    def plan_path(self, query: ObjectPathQuery) -> ObjectPath:
        """Plan a path by the service.

        Raises:
            NoObjectPath: there is none; the error may name the removable bodies that block it.
            PlannerError: the service does not answer.
        """
        request = PlanWaypoints.Request(object=query.goal.object, goal=pose_to_message(query.goal.pose, "goal"))
        request.checks = int(query.max_checks) if np.isfinite(query.max_checks) else 0
        _fill(request, query.scene, query.state, query.seed, query.time_limit)
        response = self._caller.ask(PlanWaypoints, "plan_waypoints", request, request.time_limit)
        if response.error.code == ErrorCode.SUCCESS:
            return path_from_response(response)
        error = error_from_message(response.error)
        if not isinstance(error, WaypointError):
            raise error
        without = tuple(response.free_without) if response.removal_known else None
        path = path_from_response(response) if response.path.poses else None
        raise NoObjectPath(error.reason, tuple(response.blocking), without, path)


class RosContactFinder:
    """Implements :class:`hmap_core.planner.protocols.ContactFinder` by the service ``propose_contacts``."""

    def __init__(self, caller: Caller):
        self._caller = caller

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """As the protocol says; raises PlannerError, too, if the service does not answer."""
        request = ProposeContacts.Request(
            object=query.object,
            robots=list(query.robots),
            object_poses=poses_to_messages(query.object_poses),
            count=int(query.count),
            min_reach=query.min_reach,
        )
        if query.cloud is not None:
            request.cloud = cloud_to_message(query.object, query.state.poses[query.object], query.cloud)
        _fill(request, query.scene, query.state, query.seed, query.time_limit)
        response = self._caller.call(ProposeContacts, "propose_contacts", request, request.time_limit)
        return [contact_from_message(query.scene, message) for message in response.contacts]


class RosContactChecker:
    """Implements :class:`hmap_core.planner.protocols.ContactChecker` by the service ``check_contacts``.

    The checks of the rigid hand alone are made there, too; only :meth:`promising` makes them in this process.
    """

    def __init__(self, caller: Caller):
        self._caller, self._local = caller, LocalContactChecker()

    def check(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[RobotContact]:
        """As the protocol says; raises PlannerError, too, if the service does not answer."""
        if not contacts:
            return []
        request = CheckContacts.Request(
            object=query.object,
            contacts=[candidate_to_message(contact, query.robot, query.object) for contact in contacts],
            object_poses=poses_to_messages(query.object_poses),
            min_reach=max(0, beyond + 1),
        )
        _fill(request, query.scene, query.state, int(query.rng.integers(MAX_SEED)), CHECK_LIMIT)
        response = self._caller.call(CheckContacts, "check_contacts", request, request.time_limit)
        results = zip(contacts, response.results, strict=True)
        return [
            feasible_contact(query.scene, query.robot, contact, result)
            for contact, result in results
            if result.feasible
        ]

    def promising(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[ContactPoint]:
        """As the protocol says."""
        return self._local.promising(query, contacts, beyond)


class RosSegmentPlanner:
    """Implements :class:`hmap_core.planner.protocols.SegmentPlanner`: segments by the service ``solve_segment``.

    Picking and placing a tool is planned in this process.
    """

    def __init__(self, caller: Caller):
        self._caller, self._local = caller, KomoSegmentPlanner()

    def plan_segment(self, query: SegmentQuery) -> SubTrajectory:
        """As the protocol says; raises PlannerError, too, if the service does not answer."""
        request = SolveSegment.Request(
            object=query.object,
            robot=query.contact.robot,
            contact=contact_to_message(query.contact, query.object),
            object_poses=poses_to_messages(query.object_poses),
        )
        _fill(request, query.scene, query.state, query.seed, query.time_limit)
        response = self._caller.call(SolveSegment, "solve_segment", request, request.time_limit)
        return motion_from_response(query.scene, response)

    def plan_pick(self, query: ToolQuery) -> SubTrajectory:
        """As the protocol says."""
        return self._local.plan_pick(query)

    def plan_place(self, query: ToolQuery) -> SubTrajectory:
        """As the protocol says."""
        return self._local.plan_place(query)

    def plan_shared(self, query: SharedQuery) -> SubTrajectory:
        """As the protocol says; raises PlannerError, too, if the service does not answer."""
        first, *partners = query.contacts
        request = SolveSegment.Request(
            object=query.object,
            robot=first.robot,
            contact=contact_to_message(first, query.object),
            partners=[contact_to_message(partner, query.object) for partner in partners],
            hand_over=query.hand_over,
            object_poses=poses_to_messages(query.object_poses),
        )
        _fill(request, query.scene, query.state, query.seed, query.time_limit)
        response = self._caller.call(SolveSegment, "solve_segment", request, request.time_limit)
        return motion_from_response(query.scene, response)


class _LastScene:
    """Converts scenes to messages; all requests of a plan have the same scene, which is converted once."""

    def __init__(self) -> None:
        self._last: tuple[Scene | None, SceneMessage] = None, SceneMessage()

    def message(self, scene: Scene) -> SceneMessage:
        """The message of a scene; it is not changed afterwards."""
        known, message = self._last
        if known is not scene:
            message = scene_to_message(scene)
            self._last = scene, message
        return message


_SCENES = _LastScene()


def _fill(request: Any, scene: Scene, state: SceneState, seed: int, time_limit: float) -> None:
    """Write what every planning request holds."""
    request.scene = _SCENES.message(scene)
    request.world = placement_to_message(scene, state)
    request.seed = int(seed)
    request.time_limit = max(SHORTEST, float(time_limit))
