"""The node ``contact_proposer``: contacts on an object (Algorithm 3); asks komo_optimiser what is feasible."""

import sys
import time

from hmap.conversions import cloud_from_message, known_object, known_robots
from hmap.node import HmapNode, run
from hmap.phase_conversions import contact_to_message
from hmap.remote_backend import RosBackend
from hmap.requests import Caller, scene_and_state, time_limit
from hmap_core.planner import LocalBackend
from hmap_core.types import Scene
from hmap_msgs.srv import ProposeContacts
from hmap_msgs_py.poses import poses_from_messages


class RemoteFeasibility(LocalBackend):
    """Proposes contacts here and has those that the hand alone allows checked by ``check_contacts``."""

    def __init__(self, caller: Caller, limit: float):
        super().__init__()
        self._remote, self._until = RosBackend(caller), time.monotonic() + limit

    def check_contacts(self, scene: Scene, state, object, object_poses, robot, contacts, rng, beyond=-1):
        contacts = self.promising_contacts(scene, state, object, object_poses, robot, contacts, beyond)
        left = max(0.0, self._until - time.monotonic())
        return self._remote.check_contacts(scene, state, object, object_poses, robot, contacts, rng, left)


class ContactProposer(HmapNode):
    """Serves ``propose_contacts``."""

    def __init__(self):
        super().__init__("contact_proposer")
        self._time_limit = self.parameter("time_limit", 30.0, "s, of a request that names none", 0.01, 3600.0)
        self._count = self.parameter("count", 40, "contacts at most, of a request that names no number", 1, 10000)
        patience = self.parameter("service_patience", 20.0, "s to wait for a service that is away", 0.0, 3600.0)
        self._remote = Caller(self, patience)
        self.serve(ProposeContacts, "propose_contacts", self._propose)

    def _propose(self, request: ProposeContacts.Request, response: ProposeContacts.Response) -> None:
        scene, state = scene_and_state(request)
        name = known_object(scene, request.object)
        limit = time_limit(request, self._time_limit)
        found = RemoteFeasibility(self._remote, limit).propose_contacts(
            scene,
            state,
            name,
            poses_from_messages(request.object_poses, "object_poses"),
            known_robots(scene, request.robots),
            cloud_from_message(request.cloud),
            int(request.count) or self._count,
            int(request.seed),
            limit,
        )
        response.contacts = [contact_to_message(contact, name) for contact in found]


def main(args: list[str] | None = None) -> int:
    return run(ContactProposer, args)


if __name__ == "__main__":
    sys.exit(main())
