"""Stops the arms when the supervisor that sent them has died; for hardware, whose controllers would go on."""

import threading
from collections.abc import Callable, Sequence

from action_msgs.srv import CancelGoal
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from hmap.heartbeats import MOTION_LEASE, Heartbeat
from hmap.spinning import Spinner

NAME = "motion_watchdog"


class MotionWatchdog:
    """Cancels all goals of the arms' controllers when no supervisor lives any more.

    It has a node and a thread of its own, so that it does not wait for what else its process does.
    """

    def __init__(self, namespace: str, warn: Callable[[str], None]):
        """
        Args:
            namespace: of the node.
            warn: called when arms are stopped, and with errors.
        """
        self._node = Node(NAME, namespace=namespace, use_global_arguments=False, start_parameter_services=False)
        self._warn = warn
        self._clients: dict[str, Client] = {}
        self._closed = False
        self._lock = threading.Lock()  # the heartbeat calls back in a thread of its own
        self._heartbeat = Heartbeat(self._node, "supervisor", None, self._stop, MOTION_LEASE)
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        self._spinner = Spinner(executor, lambda error: warn(f"{NAME}: {error!r}"))

    def watch(self, actions: Sequence[str]) -> None:
        """Stop the controllers with these actions, beside those that were named before."""
        for name in actions:
            if name not in self._clients:
                self._clients[name] = self._node.create_client(CancelGoal, f"{name}/_action/cancel_goal")

    def close(self) -> None:
        """End it."""
        with self._lock:
            self._closed = True
        self._spinner.stop()
        self._node.destroy_node()

    def _stop(self) -> None:
        with self._lock:
            if self._closed:  # the supervisor ends with this node
                return
            there = [name for name, client in list(self._clients.items()) if client.service_is_ready()]
            for name in there:
                self._clients[name].call_async(CancelGoal.Request())  # without a goal and a time: all of them
        if there:
            self._warn(f"no supervisor lives any more; told to stop: {', '.join(there)}")
