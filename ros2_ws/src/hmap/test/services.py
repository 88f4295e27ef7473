"""The planners' services, answered in this process by what the nodes do."""

import logging
from functools import partial
from types import SimpleNamespace

from hmap.nodes.contact_proposer import ContactProposerNode
from hmap.nodes.komo_optimiser import KomoOptimiser
from hmap.nodes.waypoint_planner import WaypointPlanner
from hmap.requests import error_from_message
from hmap_core.planner.components import proposers
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_msgs.msg import ErrorCode
from hmap_msgs_py.errors import error_to_message

LIMIT = 30.0  # s, of a request that names none


class Serving:
    """Stands in for the caller of services: asks what the nodes serve in this process, by messages.

    Attributes:
        called: names of the services that were called.
        sampled: contacts checked, as the responses say.
    """

    def __init__(self):
        checker = LocalContactChecker()
        node = {"get_logger": lambda: logging.getLogger(__name__)}
        paths = SimpleNamespace(planner=BidirectionalSearch(), _time_limit=LIMIT, **node)
        contacts = SimpleNamespace(_proposers=proposers(None), _checker=checker, _time_limit=LIMIT, _count=40, **node)
        motions = SimpleNamespace(_checker=checker, segments=KomoSegmentPlanner(), _time_limit=LIMIT, **node)
        self._handlers = {
            "plan_waypoints": partial(WaypointPlanner._plan, paths),
            "propose_contacts": partial(ContactProposerNode._propose, contacts),
            "check_contacts": partial(KomoOptimiser._check, motions),
            "solve_segment": partial(KomoOptimiser._solve, motions),
        }
        self.called: list[str] = []
        self.sampled = 0

    def call(self, service, name, request, limit):
        response = self.ask(service, name, request, limit)
        if response.error.code != ErrorCode.SUCCESS:
            raise error_from_message(response.error)
        return response

    def ask(self, service, name, request, limit):
        response = service.Response()
        self.called.append(name)
        try:
            self._handlers[name](request, response)
        except Exception as error:  # as HmapNode.serve answers
            response = service.Response(error=error_to_message(error))
        if name == "propose_contacts":
            self.sampled += response.sampled
        return response
