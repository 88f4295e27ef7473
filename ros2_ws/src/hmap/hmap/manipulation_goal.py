"""A goal of the action ``manipulate``, as its client sees it: feedback while it is worked on, and a typed result."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self
from uuid import uuid4

from unique_identifier_msgs.msg import UUID

from hmap.action_client import ActionClient
from hmap.conversions import plan_from_message
from hmap.requests import error_from_message
from hmap_core.exceptions import Code, ExecutionError, HmapError, PlannerError
from hmap_core.types import Plan
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import PlannerStatus
from hmap_msgs_py.plans import statistics_from_messages

RESULT_REPEAT = 5.0  # s after the last feedback in which the result is not there; it is asked for again
ENDED = (PlannerStatus.DONE, PlannerStatus.FAILED)  # phases after which a result comes
ACCEPT_LIMIT = 30.0  # s for the supervisor to take a goal; it does so at once, unless the request went lost


@dataclass(frozen=True)
class Feedback:
    """What the planner is doing.

    Attributes:
        phase: ``loading``, ``waypoints``, ``contacts``, ``motion``, ``checking``, ``execution``, ``stopping``,
            ``replanning``, ``done`` or ``failed``.
        waypoint, waypoints: i of I, along the object's path; 0 of 0 before there is one.
        attempt: j, the try at this waypoint.
        elapsed: s since the goal was accepted.
        text: one line for people.
    """

    phase: str
    waypoint: int
    waypoints: int
    attempt: int
    elapsed: float
    text: str


@dataclass(frozen=True)
class Result:
    """How a goal ended.

    Attributes:
        error: why it did not succeed, with its stage, code and reason, and in ``search`` what was tried, as a tree
            (:class:`hmap_core.planner.search_tree.Attempt`), where the planner keeps one; None on success.
        plan: the last plan; None where none was found.
        statistics: of the last plan and of how it came about.
        executed: whether a robot moved.
        position_error, rotation_error: m and rad that the object is off its goal at the end: executed, else planned.
    """

    error: HmapError | None
    plan: Plan | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    executed: bool = False
    position_error: float = 0.0
    rotation_error: float = 0.0

    @property
    def success(self) -> bool:
        """Whether the object is at its goal, or for ``plan_only``, whether there is a plan."""
        return self.error is None

    def check(self) -> Self:
        """The result itself.

        Raises:
            HmapError: :attr:`error`, where there is one.
        """
        if self.error is not None:
            raise self.error
        return self


class GoalInProgress:
    """A goal that was sent, and what has come back so far.

    Attributes:
        feedback: the newest; None before the first.
    """

    def __init__(
        self,
        client: ActionClient,
        message: Manipulate.Goal,
        notify: Callable[[], None],
        on_feedback: Callable[[Feedback], None] | None = None,
    ):
        """
        Args:
            client: of the action; its server is ready.
            message: the goal.
            notify: called after feedback, and once the goal has ended.
            on_feedback: called with every feedback.
        """
        self.feedback: Feedback | None = None
        self._notify, self._on_feedback = notify, on_feedback
        self._response: Manipulate.Result | None = None
        self._error: HmapError | None = None
        self._handle: Any = None
        self._ended_at: float | None = None  # s of the steady clock; when feedback said so
        self._cancel = False
        self._lock = threading.Lock()
        self._sent = time.monotonic()
        self._client, self._id = client, UUID(uuid=list(uuid4().bytes))
        client.send_goal_async(message, self._take_feedback, self._id).add_done_callback(self._accepted)

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._response is not None or self._error is not None

    def check(self, server_is_ready: bool, server_died: bool = False) -> None:
        """End it where nobody works on it any more, or nobody ever took it."""
        if self.done:
            return
        if server_died:
            self._error = ExecutionError("the node supervisor died before the goal had ended", Code.NODE_LOST)
            self._notify()
        elif not server_is_ready:
            self._end("the supervisor went away before the goal had ended")
        elif self._ended_at is not None and time.monotonic() - self._ended_at > RESULT_REPEAT:
            self._ended_at = time.monotonic()  # the response was lost, as may happen when processes are killed
            self._handle.get_result_async().add_done_callback(self._answered)
        elif self._handle is None and self.feedback is not None and time.monotonic() - self._sent > RESULT_REPEAT:
            self._accept(self._client.handle_of(self._id))  # it is worked on, so the response was lost
        elif self._handle is None and time.monotonic() - self._sent > ACCEPT_LIMIT:
            self._end(f"the supervisor did not take the goal within {ACCEPT_LIMIT:g} s")

    def cancel(self) -> None:
        """Ask for its end, now or as soon as it is accepted."""
        with self._lock:
            self._cancel = True
            handle = self._handle
        if handle is not None and self._response is None:
            handle.cancel_goal_async()

    def result(self) -> Result:
        """What the supervisor answered."""
        if self._response is None:
            return Result(self._error)
        response = self._response
        statistics = statistics_from_messages(response.statistics)
        error = None if response.success else error_from_message(response.error)
        if error is not None:
            error.search = statistics.get("search")
        return Result(
            error=error,
            plan=plan_from_message(response.plan) if response.plan.segments else None,
            statistics=statistics,
            executed=response.executed,
            position_error=response.position_error,
            rotation_error=response.rotation_error,
        )

    def _accepted(self, future: Any) -> None:
        handle = future.result()
        if handle.accepted:
            self._accept(handle)
        else:
            self._end("the supervisor refused the goal")

    def _accept(self, handle: Any) -> None:
        """Ask for the result, once."""
        with self._lock:
            if self._handle is not None:
                return
            self._handle = handle
            cancel = self._cancel
            if self.feedback is not None and self.feedback.phase in ENDED:
                self._ended_at = time.monotonic()
        handle.get_result_async().add_done_callback(self._answered)
        if cancel:
            handle.cancel_goal_async()

    def _end(self, reason: str) -> None:
        """Take it as ended without a result."""
        self._error = PlannerError(reason, Code.SERVICE_UNAVAILABLE)
        self._notify()

    def _answered(self, future: Any) -> None:
        self._response = future.result().result
        self._notify()

    def _take_feedback(self, message: Any) -> None:
        status = message.feedback.status
        self.feedback = Feedback(
            status.phase, status.waypoint, status.waypoint_count, status.attempt, status.elapsed, status.text
        )
        if status.phase in ENDED and self._handle is not None:
            self._ended_at = time.monotonic()
        if self._on_feedback is not None:
            self._on_feedback(self.feedback)
        self._notify()
