"""Reads the common parts of planning requests, and calls other nodes' services."""

import copy
import queue
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from rclpy.client import Client
from rclpy.task import Future

from hmap.conversions import scene_from_message, state_from_message
from hmap.heartbeats import Heartbeat
from hmap.node import HmapNode
from hmap_core.exceptions import (
    Code,
    ContactError,
    ExecutionError,
    HmapError,
    InputError,
    MotionError,
    PlannerError,
    WaypointError,
)
from hmap_core.trajectory.measured_limits import within_limits
from hmap_core.types import Scene, SceneState
from hmap_msgs.msg import ErrorCode

POLL = 0.1  # s between checks for the service and for a cancellation
ANSWER_MARGIN = 10.0  # s that a response can take beyond the time limit of its request
REPEAT = 10.0  # s without a response after which a request is sent again; doubles every time
OFFERED_BY = {  # service -> the node that offers it
    "load_scene": "world",
    "plan_waypoints": "waypoint_planner",
    "propose_contacts": "contact_proposer",
    "check_contacts": "komo_optimiser",
    "solve_segment": "komo_optimiser",
}
STAGES = {
    kind.stage: kind for kind in (InputError, WaypointError, ContactError, MotionError, PlannerError, ExecutionError)
}


def scene_and_state(request, tell: Callable[[str], None]) -> tuple[Scene, SceneState]:
    """The scene and the state of a request.

    Args:
        request: has both.
        tell: called with what was changed of the state: joints and fingers that are measured a little beyond a limit.

    Raises:
        InputError: the scene or the state is not allowed.
        ConversionError: the request is malformed.
    """
    scene = scene_from_message(request.scene)
    state, notes = within_limits(scene, state_from_message(scene, request.world))
    for note in notes:
        tell(note)
    return scene, state


def time_limit(request, default: float) -> float:
    """The time limit of a request in s; 0 means the node's default.

    Raises:
        InputError: it is negative or not finite.
    """
    value = float(request.time_limit)
    if not (np.isfinite(value) and value >= 0.0):
        raise InputError(f"time_limit = {value} s: must be 0 (the node's own) or more")
    return value or default


def error_from_message(message: ErrorCode) -> HmapError:
    """The exception that an error message describes."""
    code = Code(message.code) if message.code in set(Code) else Code.INTERNAL
    return STAGES.get(message.stage, HmapError)(message.reason, code)


class Caller:
    """Calls services from a thread that can wait, and tolerates nodes that are restarted.

    Args:
        node: the node that makes the clients.
        patience: s to wait for a service that does not exist, or whose node has died.
        services: whose nodes are watched, so that their death is noticed at once.
    """

    def __init__(self, node: HmapNode, patience: float, services: Iterable[str] = ()):
        self._node, self._patience = node, patience
        self._canceled: Callable[[], bool] = lambda: False
        self._tell: Callable[[str], None] = lambda text: None
        self._clients: dict[str, Client] = {}
        nodes = {role: Heartbeat(node, role, node.group) for role in sorted({OFFERED_BY[name] for name in services})}
        self._heartbeats = {name: nodes[OFFERED_BY[name]] for name in services}

    def until(self, canceled: Callable[[], bool], tell: Callable[[str], None] = lambda text: None) -> "Caller":
        """A caller with the same clients.

        Args:
            canceled: polled while waiting; true ends the call.
            tell: called with the node that is waited for, where one has died.
        """
        other = copy.copy(self)
        other._canceled, other._tell = canceled, tell
        return other

    def client(self, service_type: type, name: str) -> Client:
        """The client of a service; it is made once."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(service_type, name, callback_group=self._node.group)
        return self._clients[name]

    def call(self, service_type: type, name: str, request: Any, limit: float) -> Any:
        """Call a service, as :meth:`ask`; an error of the response is raised.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT or CANCELED.
            HmapError: the error of the response, with its stage and code.
        """
        response = self.ask(service_type, name, request, limit)
        if response.error.code != ErrorCode.SUCCESS:
            raise error_from_message(response.error)
        return response

    def ask(self, service_type: type, name: str, request: Any, limit: float) -> Any:
        """Call a service.

        A request is lost if its node dies. It is sent again as soon as the node is started anew. Where nobody watches
        the node, it is sent again after REPEAT and then increasing times, since DDS regards a dead process as alive for
        some seconds. The first response counts.

        Args:
            service_type: of the service.
            name: its name.
            request: the request.
            limit: s that the work of the service can take.

        Returns:
            The response, whatever its ``error`` is.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT or CANCELED.
        """
        client = self.client(service_type, name)
        self._wait_for(client, name)
        deadline = time.monotonic() + limit + ANSWER_MARGIN
        answers: queue.Queue = queue.Queue()
        asked: list[Future] = []
        try:
            return self._ask(client, name, request, deadline, answers, asked)
        finally:
            for future in asked:
                client.remove_pending_request(future)

    def _wait_for(self, client: Client, name: str) -> None:
        until, told = time.monotonic() + self._patience, False
        while self.lost(name) or not client.service_is_ready():
            self._check_canceled()
            role = OFFERED_BY.get(name, name)
            if self.lost(name) and not told:
                told = True
                text = f"the node {role!r} has died; it gets {self._patience:g} s to be started anew"
                self._node.get_logger().warning(text)
                self._tell(text)
            if time.monotonic() > until:
                died = f": the node {role!r} has died" if self.lost(name) else f": is the node {role!r} running?"
                raise PlannerError(
                    f"no node has offered the service {name!r} for {self._patience:g} s{died}",
                    Code.SERVICE_UNAVAILABLE,
                )
            self._node.stopping.wait(POLL)

    def lost(self, name: str) -> bool:
        """Whether the node that offers a service, and that is watched, has died."""
        heartbeat = self._heartbeats.get(name)
        return heartbeat is not None and heartbeat.lost

    def _ask(self, client: Client, name: str, request, deadline: float, answers: queue.Queue, asked: list):
        repeat, again = REPEAT, 0.0
        while True:
            now = time.monotonic()
            if now > deadline:
                raise PlannerError(f"the service {name!r} did not answer in time", Code.TIME_LIMIT)
            if now >= again or self.lost(name):
                self._wait_for(client, name)
                future = client.call_async(request)
                asked.append(future)
                future.add_done_callback(answers.put)
                again, repeat = now + repeat, 2.0 * repeat
            try:
                return answers.get(timeout=POLL).result()
            except queue.Empty:
                self._check_canceled()

    def _check_canceled(self) -> None:
        if self._canceled() or self._node.stopping.is_set():
            raise PlannerError("canceled", Code.CANCELED)
