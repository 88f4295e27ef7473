"""Reads what every planning request holds, and calls other nodes' services."""

import copy
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.client import Client

from hmap.conversions import scene_from_message, state_from_message
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
from hmap_core.types import Scene, SceneState
from hmap_msgs.msg import ErrorCode

POLL = 0.1  # s between looks at whether a service is there and whether the caller still wants it
ANSWER_MARGIN = 10.0  # s that an answer may take beyond the time limit of its request
GONE = 1.0  # s without its service after which a node counts as away while it works
STAGES = {
    kind.stage: kind for kind in (InputError, WaypointError, ContactError, MotionError, PlannerError, ExecutionError)
}


def scene_and_state(request) -> tuple[Scene, SceneState]:
    """What a request says of the world.

    Raises:
        InputError, ConversionError: it is malformed.
    """
    scene = scene_from_message(request.scene)
    return scene, state_from_message(scene, request.world)


def time_limit(request, default: float) -> float:
    """The time limit of a request in seconds; 0 means the node's own.

    Raises:
        InputError: it is negative or not finite.
    """
    value = float(request.time_limit)
    if not (np.isfinite(value) and value >= 0.0):
        raise InputError(f"time_limit = {value} s: must be 0 (the node's own) or more")
    return value or default


def error_from_message(message: ErrorCode) -> HmapError:
    """The exception that an error message came from."""
    code = Code(message.code) if message.code in set(Code) else Code.INTERNAL
    return STAGES.get(message.stage, HmapError)(message.reason, code)


class Caller:
    """Calls services from a thread that may wait, and gets over a node that goes away and comes back."""

    def __init__(self, node: HmapNode, patience: float, canceled: Callable[[], bool] = lambda: False):
        """
        Args:
            patience: seconds to wait for a service that is not there.
            canceled: asked while waiting.
        """
        self._node, self._patience, self._canceled = node, patience, canceled
        self._clients: dict[str, Client] = {}

    def until(self, canceled: Callable[[], bool]) -> "Caller":
        """The same, with the same clients, that stops waiting when ``canceled`` says so."""
        other = copy.copy(self)
        other._canceled = canceled
        return other

    def client(self, service_type: type, name: str) -> Client:
        """The client of a service; made once."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(service_type, name, callback_group=self._node.group)
        return self._clients[name]

    def call(self, service_type: type, name: str, request: Any, limit: float) -> Any:
        """The response, whose ``error`` says success.

        Args:
            limit: seconds that the work itself may take.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT, CANCELED.
            HmapError: of the stage and code that the response names.
        """
        client = self.client(service_type, name)
        deadline = time.monotonic() + limit + ANSWER_MARGIN
        while True:
            self._wait_for(client, name)
            response = self._ask(client, name, request, deadline)
            if response is not None:
                return response
            self._node.get_logger().warning(f"{name}: the node went away; asking again once it is back")

    def _wait_for(self, client: Client, name: str) -> None:
        until = time.monotonic() + self._patience
        while not client.service_is_ready():
            self._check_canceled()
            if time.monotonic() > until:
                raise PlannerError(f"no node has offered the service {name!r} for {self._patience:g} s",
                                   Code.SERVICE_UNAVAILABLE)  # fmt: skip
            self._node.stopping.wait(POLL)

    def _ask(self, client: Client, name: str, request, deadline: float):
        """The response, or None when the node has gone away meanwhile."""
        arrived = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: arrived.set())
        seen = time.monotonic()
        try:
            while not arrived.wait(POLL):
                self._check_canceled()
                now = time.monotonic()
                seen = now if client.service_is_ready() else seen
                if now - seen > GONE:
                    return None
                if now > deadline:
                    raise PlannerError(f"the service {name!r} did not answer in time", Code.TIME_LIMIT)
        finally:
            if not future.done():
                client.remove_pending_request(future)
        response = future.result()
        if response.error.code != ErrorCode.SUCCESS:
            error = error_from_message(response.error)
            error.response = response
            raise error
        return response

    def _check_canceled(self) -> None:
        if self._canceled() or self._node.stopping.is_set():
            raise PlannerError("canceled", Code.CANCELED)
