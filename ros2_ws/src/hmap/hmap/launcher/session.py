"""The launcher's own node: sees which nodes are up, sends the goal of ``manipulate``, and brings its result."""

import threading
import time
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from hmap.action_client import ActionClient
from hmap.spinning import Spinner
from hmap_core.exceptions import Code, PlannerError
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import PlannerStatus, WorldState

POLL = 0.1  # s
CANCEL_TIMEOUT = 10.0  # s for a canceled goal to end
SERVICES = {  # node -> what it offers once it is up
    "world": "get_scene",
    "waypoint_planner": "plan_waypoints",
    "contact_proposer": "propose_contacts",
    "komo_optimiser": "solve_segment",
}

OnStatus = Callable[[PlannerStatus], None]


class Session:
    """A connection to the graph. Used as a context."""

    def __enter__(self) -> "Session":
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("hmap_up")
        self._client = ActionClient(self.node, Manipulate, "manipulate")
        self._has_state = threading.Event()
        self.node.create_subscription(WorldState, "world_state", lambda _: self._has_state.set(), 1)
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        self._spinner = Spinner(executor, lambda error: self.node.get_logger().error(repr(error)))
        return self

    def __exit__(self, *_) -> None:
        self._spinner.stop()
        self._client.destroy()
        self.node.destroy_node()
        rclpy.shutdown()

    def forget_state(self) -> None:
        """Take perception for not ready until it publishes a state again."""
        self._has_state.clear()

    def other_graph(self) -> bool:
        """Whether a supervisor is there already."""
        return self._client.server_is_ready()

    def up(self, names) -> list[str]:
        """Those of the nodes that are ready for work."""
        services = {name.rpartition("/")[2] for name, _ in self.node.get_service_names_and_types()}
        ready = {
            "perception": self._has_state.is_set(),
            "supervisor": self._client.server_is_ready(),
            **{name: name in self.node.get_node_names() for name in ("recorder", "dynamic_obstacles")},
        }
        ready |= {node: service in services for node, service in SERVICES.items()}
        return [name for name in names if ready.get(name, False)]

    def manipulate(self, goal: Manipulate.Goal, on_status: OnStatus, between: Callable[[], None]) -> Manipulate.Result:
        """Send a goal and wait for its result.

        Args:
            on_status: called with the feedback.
            between: called now and then while waiting; what it raises ends the waiting, and the goal is canceled.
        """
        sent = self._client.send_goal_async(goal, lambda feedback: on_status(feedback.feedback.status))
        try:
            _wait(sent, between)
            handle = sent.result()
            if not handle.accepted:
                raise PlannerError("the supervisor refused the goal", Code.SERVICE_UNAVAILABLE)
            answer = handle.get_result_async()
            _wait(answer, between)
        except BaseException:
            self._cancel(sent)
            raise
        return answer.result().result

    def _cancel(self, sent) -> None:
        if sent.done() and sent.result().accepted:
            handle = sent.result()
            ended = handle.get_result_async()
            handle.cancel_goal_async()
            until = time.monotonic() + CANCEL_TIMEOUT
            while not ended.done() and time.monotonic() < until:
                time.sleep(POLL)


def _wait(future, between: Callable[[], None]) -> None:
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    while not done.wait(POLL):
        between()
