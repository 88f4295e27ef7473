"""What a node sees of a running graph: topics with their messages, actions, services, parameters of nodes."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from hmap.doctor.findings import Endpoint, Topic
from hmap_msgs_py.times import seconds_from_message

POLL = 0.02  # s
ANSWER = 2.0  # s for a node to tell its parameters
DEPTH = 50  # messages


class GraphView:
    """Looks at the graph through a node that somebody else spins.

    Attributes:
        node: that looks.
    """

    def __init__(self, node: Node, now: Callable[[], float | None]):
        """
        Args:
            node: that looks.
            now: s of the graph's clock.
        """
        self.node, self._now = node, now
        self._topics: dict[str, Topic] = {}

    def nodes(self) -> list[str]:
        """Full names of all nodes; the same name twice where two have it."""
        return [f"{space.rstrip('/')}/{name}" for name, space in self.node.get_node_names_and_namespaces()]

    def watch(self, name: str, kind: type, note: Callable[[Any], object] | None = None) -> Topic:
        """Listen to a topic from now on, whatever its publishers offer.

        Args:
            name: relative to the node's namespace, or absolute.
            kind: type of its messages.
            note: called with each message.
        """
        full = self.node.resolve_topic_name(name)
        if full in self._topics:
            return self._topics[full]
        topic = self._topics[full] = Topic(full)
        offers = [info.qos_profile for info in self.node.get_publishers_info_by_topic(full)]
        reliable = bool(offers) and all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offers)
        latched = bool(offers) and all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offers)
        quality = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

        def receive(message: Any) -> None:
            topic.messages, topic.data = topic.messages + 1, message
            topic.arrived = self._now() or 0.0
            header = getattr(message, "header", None)
            if header is not None:
                stamp = seconds_from_message(header.stamp)
                topic.stamps = (topic.stamps[0] if topic.stamps else stamp), stamp
                topic.frames.add(header.frame_id)
            if note is not None:
                note(message)

        types = dict(self.node.get_topic_names_and_types()).get(full, ())
        if not types or kind_name(kind) in types:
            self.node.create_subscription(kind, full, receive, quality)
        return topic

    def refresh(self, topic: Topic) -> Topic:
        """Note who publishes and subscribes to a topic now; this node itself does not count."""
        own = self.node.get_fully_qualified_name()

        def ends(infos: Sequence[Any]) -> tuple[Endpoint, ...]:
            found = [
                Endpoint(
                    f"{info.node_namespace.rstrip('/')}/{info.node_name}",
                    info.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                    info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
                )
                for info in infos
            ]
            return tuple(end for end in found if end.node != own)

        publishers = self.node.get_publishers_info_by_topic(topic.name)
        topic.publishers = ends(publishers)
        topic.subscribers = ends(self.node.get_subscriptions_info_by_topic(topic.name))
        topic.types = tuple(sorted({info.topic_type for info in publishers}))
        return topic

    def action(self, name: str) -> tuple[tuple[str, ...], int]:
        """Types of an action, and how many nodes offer it."""
        full = self.node.resolve_service_name(name)
        status = self.node.get_publishers_info_by_topic(f"{full}/_action/status")
        services = dict(self.node.get_service_names_and_types())
        types = [kind.removesuffix("_SendGoal") for kind in services.get(f"{full}/_action/send_goal", ())]
        return tuple(types), len(status) if types else 0

    def service(self, name: str) -> bool:
        """Whether a service is offered."""
        return self.node.resolve_service_name(name) in {found for found, _ in self.node.get_service_names_and_types()}

    def state(self, node: str) -> str:
        """The lifecycle state of a node, such as ``active``; empty where it is no managed node, or does not answer."""
        name = f"{node}/get_state"
        if not self.service(name):
            return ""
        client = self.node.create_client(GetState, name)
        try:
            if not client.wait_for_service(ANSWER):
                return ""
            future, until = client.call_async(GetState.Request()), time.monotonic() + ANSWER
            while not future.done() and time.monotonic() < until:
                time.sleep(POLL)
            answer = future.result() if future.done() else None
            return "" if answer is None else str(answer.current_state.label)
        finally:
            self.node.destroy_client(client)

    def parameters(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """Values of a node's parameters; those that it has not, or does not tell, are left out."""
        client = self.node.create_client(GetParameters, f"{node}/get_parameters")
        try:
            if not client.wait_for_service(ANSWER):
                return {}
            # one by one: a name that the node does not declare costs the values of all that are asked with it
            asked = {name: client.call_async(GetParameters.Request(names=[name])) for name in names}
            until = time.monotonic() + ANSWER
            while not all(future.done() for future in asked.values()) and time.monotonic() < until:
                time.sleep(POLL)
            answers = {name: future.result() for name, future in asked.items() if future.done()}
            values = {
                name: answer.values[0] for name, answer in answers.items() if answer is not None and answer.values
            }
            return {name: found for name, value in values.items() if (found := _value(value)) is not None}
        finally:
            self.node.destroy_client(client)


def kind_name(kind: type) -> str:
    """The name of a message type, such as ``sensor_msgs/msg/JointState``."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def _value(value: ParameterValue) -> Any:
    if value.type == ParameterType.PARAMETER_NOT_SET:
        return None
    found = Parameter(value=value).value
    fields = {
        ParameterType.PARAMETER_BOOL: "bool_value",
        ParameterType.PARAMETER_INTEGER: "integer_value",
        ParameterType.PARAMETER_DOUBLE: "double_value",
        ParameterType.PARAMETER_STRING: "string_value",
        ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
    }
    return getattr(found, fields[value.type]) if value.type in fields else None
