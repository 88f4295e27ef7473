"""Reads what every planning request holds, and calls other nodes' services."""

import copy
import queue
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
REPEAT = 10.0  # s without an answer after which a request is sent again; doubles every time
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

        A request goes lost when its node dies, and DDS takes a dead process for alive for some seconds. So a request
        without an answer is sent again, after REPEAT and then ever more seconds; the first answer counts.

        Args:
            limit: seconds that the work itself may take.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT, CANCELED.
            HmapError: of the stage and code that the response names.
        """
        client = self.client(service_type, name)
        self._wait_for(client, name)
        deadline = time.monotonic() + limit + ANSWER_MARGIN
        answers: queue.Queue = queue.Queue()
        asked = []
        try:
            response = self._ask(client, name, request, deadline, answers, asked)
        finally:
            for future in asked:
                client.remove_pending_request(future)
        if response.error.code != ErrorCode.SUCCESS:
            error = error_from_message(response.error)
            error.response = response
            raise error
        return response

    def _wait_for(self, client: Client, name: str) -> None:
        until = time.monotonic() + self._patience
        while not client.service_is_ready():
            self._check_canceled()
            if time.monotonic() > until:
                raise PlannerError(
                    f"no node has offered the service {name!r} for {self._patience:g} s", Code.SERVICE_UNAVAILABLE
                )
            self._node.stopping.wait(POLL)

    def _ask(self, client: Client, name: str, request, deadline: float, answers: queue.Queue, asked: list):
        repeat, again = REPEAT, 0.0
        while True:
            now = time.monotonic()
            if now > deadline:
                raise PlannerError(f"the service {name!r} did not answer in time", Code.TIME_LIMIT)
            if now >= again:
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
