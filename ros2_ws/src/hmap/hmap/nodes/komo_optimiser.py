"""The node ``komo_optimiser``: checks contacts in batches and plans segments. Several instances may run in parallel."""

import sys
from collections.abc import Sequence

import numpy as np

from hmap.conversions import known_object, known_robots
from hmap.lifecycle import ManagedNode
from hmap.node import run
from hmap.phase_conversions import contact_from_message, motion_to_response, point_from_message
from hmap.requests import scene_and_state, time_limit
from hmap_core.exceptions import Code, ContactError, InputError
from hmap_core.planner import ContactQuery, RobotContact, SegmentQuery, SharedQuery, plugins
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_msgs.srv import CheckContacts, SolveSegment
from hmap_msgs_py.contacts import feasibility_to_message
from hmap_msgs_py.errors import error_to_message
from hmap_msgs_py.poses import poses_from_messages


class KomoOptimiser(ManagedNode):
    """Serves ``check_contacts`` and ``solve_segment``.

    Attributes:
        segments: plans segments.
    """

    plans = True

    def __init__(self):
        super().__init__("komo_optimiser")
        self._time_limit = self.parameter("time_limit", 30.0, "s, of a request that names none", 0.01, 3600.0)
        name = self.parameter("transit_planner", "hmap", "searches transits of arms; see `hmap plugins`")
        self._checker = LocalContactChecker()
        self.segments = KomoSegmentPlanner(plugins.create(plugins.TRANSIT_PLANNERS, name))
        self.serve(CheckContacts, "check_contacts", self._check)
        self.serve(SolveSegment, "solve_segment", self._solve)

    def _check(self, request: CheckContacts.Request, response: CheckContacts.Response) -> None:
        scene, state = scene_and_state(request, self.get_logger().warning)
        name = known_object(scene, request.object)
        poses = _poses(request)
        rng = np.random.default_rng(int(request.seed))
        points = [point_from_message(message) for message in request.contacts]
        owners = [message.robot for message in request.contacts]
        feasible: dict[int, RobotContact] = {}
        for robot in dict.fromkeys(owners):
            known_robots(scene, [robot])
            own = [point for point, owner in zip(points, owners, strict=True) if owner == robot]
            query = ContactQuery(scene, state, name, poses, robot, rng)
            found = self._checker.check(query, own, int(request.min_reach) - 1)
            feasible |= {id(contact.contact): contact for contact in found}
        reason = error_to_message(
            ContactError("not reachable without collision, or others reach farther", Code.OUT_OF_REACH)
        )
        response.results = [
            feasibility_to_message(feasible[id(point)].keyframes, clear=feasible[id(point)].clear)
            if id(point) in feasible
            else feasibility_to_message(None, reason)
            for point in points
        ]

    def _solve(self, request: SolveSegment.Request, response: SolveSegment.Response) -> None:
        scene, state = scene_and_state(request, self.get_logger().warning)
        name = known_object(scene, request.object)
        contact = contact_from_message(scene, request.contact)
        limit = time_limit(request, self._time_limit)
        poses, seed = _poses(request), int(request.seed)
        if request.partners:
            contacts = _two_robots(contact, [contact_from_message(scene, message) for message in request.partners])
            _check_reach(contacts, len(poses), request.hand_over)
            shared = SharedQuery(scene, state, name, contacts, poses, seed, limit, bool(request.hand_over))
            motion_to_response(scene, self.segments.plan_shared(shared), response)
            return
        query = SegmentQuery(scene, state, name, contact, poses, seed, limit)
        motion_to_response(scene, self.segments.plan_segment(query), response)


def _poses(request) -> np.ndarray:
    """The object's poses (M, 7), at least the present one and one more."""
    if len(request.object_poses) < 2:
        raise InputError(f"object_poses has {len(request.object_poses)} poses; at least 2 are needed")
    return poses_from_messages(request.object_poses, "object_poses")


def _two_robots(contact: RobotContact, partners: Sequence[RobotContact]) -> tuple[RobotContact, RobotContact]:
    """The contacts of two robots that handle an object together."""
    if len(partners) != 1:
        raise InputError(f"partners has {len(partners)} contacts; allowed: none, or that of a second robot")
    if partners[0].robot == contact.robot:
        raise InputError(f"partners[0].robot is '{contact.robot}', which makes the first contact as well")
    return contact, partners[0]


def _check_reach(contacts: Sequence[RobotContact], poses: int, hand_over: bool) -> None:
    """Checks that two robots have configurations where they need them."""
    if hand_over and poses != 3:
        raise InputError(f"object_poses has {poses} poses; a hand-over has 3: now, where it changes hands, the last")
    wanted = 1 if hand_over else poses - 1
    for contact in contacts:
        if contact.reach != wanted:
            raise InputError(
                f"the contact of '{contact.robot}' has reach {contact.reach}; with {poses} object_poses it has to be "
                f"{wanted}{', as it is passed on' if hand_over else ''}"
            )


def main(args: list[str] | None = None) -> int:
    """Run the node; its exit code."""
    return run(KomoOptimiser, args)


if __name__ == "__main__":
    sys.exit(main())
