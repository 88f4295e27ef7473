"""The node ``contact_proposer``: proposes contacts on an object and checks them (Algorithm 3), as a service."""

import sys
from collections.abc import Sequence

from hmap.conversions import cloud_from_message, known_object, known_robots
from hmap.lifecycle import ManagedNode
from hmap.node import run
from hmap.phase_conversions import contact_to_message
from hmap.remote_components import RosContactChecker
from hmap.requests import Caller, scene_and_state, time_limit
from hmap_core.planner import ContactQuery, ContactSearchQuery, RobotContact, plugins
from hmap_core.planner.components import proposers
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.protocols import ContactChecker
from hmap_core.types import ContactPoint
from hmap_msgs.srv import ProposeContacts
from hmap_msgs_py.poses import poses_from_messages


class CountingChecker:
    """A checker that counts the contacts it gets.

    Attributes:
        count: number of contacts so far.
    """

    def __init__(self, checker: ContactChecker):
        self._checker, self.count = checker, 0

    def check(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[RobotContact]:
        """As :meth:`hmap_core.planner.protocols.ContactChecker.check`."""
        self.count += len(contacts)
        return self._checker.check(query, contacts, beyond)

    def promising(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[ContactPoint]:
        """As :meth:`hmap_core.planner.protocols.ContactChecker.promising`."""
        return self._checker.promising(query, contacts, beyond)


class ContactProposerNode(ManagedNode):
    """Serves ``propose_contacts``.

    Attributes:
        proposer: proposes contacts before sampled ones.
    """

    plans = True

    def __init__(self):
        super().__init__("contact_proposer")
        self._time_limit = self.parameter("time_limit", 30.0, "s, of a request that names none", 0.01, 3600.0)
        self._count = self.parameter("count", 40, "contacts at most, of a request that names no number", 1, 10000)
        patience = self.parameter("service_patience", 5.0, "s to wait for a node that is away or has died", 0.0, 3600.0)
        name = self.parameter(
            "proposer", plugins.DEFAULT_PROPOSER, "proposes contacts before sampled ones; see `hmap plugins`"
        )
        self.proposer = plugins.create(plugins.CONTACT_PROPOSERS, name)
        self._proposers = proposers(self.proposer)
        text = "whether komo_optimiser checks contacts, instead of this node"
        remote = self.parameter("check_remotely", False, text)
        self._checker = (
            RosContactChecker(Caller(self, patience, ["check_contacts"])) if remote else LocalContactChecker()
        )
        self.serve(ProposeContacts, "propose_contacts", self._propose)

    def _propose(self, request: ProposeContacts.Request, response: ProposeContacts.Response) -> None:
        scene, state = scene_and_state(request, self.get_logger().warning)
        name = known_object(scene, request.object)
        checker = CountingChecker(self._checker)
        query = ContactSearchQuery(
            scene,
            state,
            name,
            poses_from_messages(request.object_poses, "object_poses"),
            tuple(known_robots(scene, request.robots)),
            cloud_from_message(request.cloud),
            int(request.count) or self._count,
            int(request.seed),
            time_limit(request, self._time_limit),
            min_reach=int(request.min_reach),
        )
        try:
            found = ProposeAndCheck(self._proposers, checker).find_contacts(query)
        finally:
            response.sampled = checker.count
        response.contacts = [contact_to_message(contact, name) for contact in found]


def main(args: list[str] | None = None) -> int:
    """Run the node; its exit code."""
    return run(ContactProposerNode, args)


if __name__ == "__main__":
    sys.exit(main())
