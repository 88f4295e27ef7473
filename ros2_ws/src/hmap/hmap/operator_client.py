"""The operator's side of a supervisor: pause, resume, stop and confirm, and the scales of speed and acceleration."""

import time

from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from hmap_core.exceptions import Code, PlannerError

SERVICES = ("pause", "resume", "stop", "confirm")
LIMIT = 15.0  # s for an answer, on a busy machine
REPEAT = 2.0  # s without an answer after which a request is sent again
POLL = 0.005  # s


class OperatorClient:
    """Calls the services of a supervisor. The node has to be spun by somebody else meanwhile."""

    def __init__(self, node: Node, supervisor: str = "supervisor"):
        """
        Args:
            node: that calls.
            supervisor: name of the supervisor, in the node's namespace.
        """
        self._node = node
        self._clients = {name: node.create_client(Trigger, f"{supervisor}/{name}") for name in SERVICES}
        self._speed = node.create_publisher(Float64, "speed_scaling", 1)
        self._acceleration = node.create_publisher(Float64, "acceleration_scaling", 1)

    def available(self) -> set[str]:
        """The services that a supervisor offers now, and ``speed`` where one listens to :meth:`scale_speed`."""
        found = {name for name, client in self._clients.items() if client.service_is_ready()}
        return found | ({"speed"} if self._node.count_subscribers("speed_scaling") else set())

    def call(self, name: str) -> tuple[bool, str]:
        """Call ``pause``, ``resume``, ``stop`` or ``confirm``.

        The middleware may lose a request, above all where processes were killed. It is sent again every REPEAT, since
        none of these does more when it comes twice, and the first answer counts.

        Returns:
            whether it did anything, and a sentence.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE; the supervisor does not answer.
        """
        until, again = time.monotonic() + LIMIT, 0.0
        if not self._clients[name].wait_for_service(LIMIT):
            raise PlannerError(f"no supervisor offers the service {name!r}", Code.SERVICE_UNAVAILABLE)
        sent: list[Future] = []
        try:
            while True:
                now = time.monotonic()
                if now > until:
                    text = f"the service {name!r} has not answered in {LIMIT:g} s"
                    raise PlannerError(text, Code.SERVICE_UNAVAILABLE)
                if now > again:
                    sent.append(self._clients[name].call_async(Trigger.Request()))
                    again = now + REPEAT
                for future in sent:
                    if future.done():
                        answer = future.result()
                        return answer.success, answer.message
                time.sleep(POLL)
        finally:
            for future in sent:
                self._clients[name].remove_pending_request(future)

    def scale_speed(self, value: float) -> None:
        """Scale all planned speeds by a value in (0, 1], also of what moves now."""
        self._speed.publish(Float64(data=float(value)))

    def scale_acceleration(self, value: float) -> None:
        """Scale all planned accelerations, and those in which arms brake, by a value in (0, 1]."""
        self._acceleration.publish(Float64(data=float(value)))
