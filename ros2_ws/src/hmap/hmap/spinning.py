"""Spins an executor in a thread, and stops it in an order that is safe for running callbacks."""

import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import (
    ConditionReachedException,
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription

EVENT_PERIOD = 1.0  # s
WATCHED = "hmap_watched"  # attribute of event handlers that are looked at all the time
APART = "hmap_apart"  # attribute of a subscription that has an executor of its own
SHORT = (Subscription, Client, ActionClient, EventHandler)  # entities whose callbacks do not wait
InvalidHandle, RCLError = rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError
# in the error where an action server was destroyed while it was waited for; rclpy ignores that of other entities
DESTROYED = "to wait set"


class _RareEvents(Executor):
    """Looks at what the middleware tells of topics once in EVENT_PERIOD, but for what :func:`watch` names.

    rclpy makes two event handlers for each publisher and subscription, to warn of others that do not fit. Looking at
    them takes three quarters of the time for which an executor looks at a node. Events wait until they are looked at.
    """

    _events_due = 0.0  # s of the steady clock
    _with_events = True

    def can_execute(self, entity: Any) -> bool:
        """As rclpy."""
        rare = isinstance(entity, EventHandler) and not getattr(entity, WATCHED, False)
        looked_at = (self._with_events or not rare) and not getattr(entity, APART, False)
        return looked_at and super().can_execute(entity)

    def _spin_once_impl(self, *arguments: Any, **options: Any) -> None:
        now = time.monotonic()
        self._with_events = now >= self._events_due
        if self._with_events:
            self._events_due = now + EVENT_PERIOD
        super()._spin_once_impl(*arguments, **options)  # type: ignore[misc]


def watch(subscription: Subscription) -> None:
    """Have executors call back at once when the middleware tells something of a subscription."""
    handlers: Any = subscription.event_handlers
    for handler in handlers:
        setattr(handler, WATCHED, True)


class MessageExecutor(_RareEvents, SingleThreadedExecutor):
    """Runs callbacks, none of which waits, in the thread that spins."""


class _Pool(MultiThreadedExecutor):
    """Runs callbacks in a pool of threads, but those that do not wait in the thread that spins.

    A message then costs neither a change of threads nor another look at everything that the node waits for.
    """

    def _spin_once_impl(self, timeout_sec: Any = None, wait_condition: Callable[[], bool] = lambda: False) -> None:
        try:
            ready: tuple[Any, Any, Any] = self.wait_for_ready_callbacks(timeout_sec, None, wait_condition)
        except (ExternalShutdownException, ShutdownException, TimeoutException, ConditionReachedException):
            return
        handler, entity, _ = ready
        if isinstance(entity, SHORT):
            handler()
            handler.result()  # raises its exception
            return
        # Until a thread of the pool has begun it, rclpy would hand it out again and again, and while it does so, this
        # thread keeps the interpreter from that one, for 5 ms each time.
        with self._tasks_lock:
            self._tasks = [entry for entry in self._tasks if entry[0] is not handler]
        self._executor.submit(self._work, ready)
        self._futures.append(handler)
        for future in [future for future in self._futures if future.done()]:
            self._futures.remove(future)
            future.result()

    def _work(self, ready: tuple[Any, Any, Any]) -> None:
        """Run a callback in the pool."""
        handler, _, _ = ready
        handler()
        if not handler.done():  # it awaits something; rclpy goes on with it
            with self._tasks_lock:
                self._tasks.append(ready)
            self.wake()


class WorkExecutor(_RareEvents, _Pool):
    """Runs callbacks in a pool of threads, since some wait."""


class ClockExecutor(SingleThreadedExecutor):
    """Follows ``/clock``, which comes several times as often as all other messages of most nodes.

    An executor looks at all entities of a node whenever one of them has news. This one looks at one subscription.
    """

    def __init__(self, node: Node, subscription: Subscription):
        """
        Args:
            node: whose other executor leaves the subscription out from now on.
            subscription: to the clock.
        """
        super().__init__(context=node.context)
        self._node, self._subscription = node, subscription
        setattr(subscription, APART, True)

    def get_nodes(self) -> list[Node]:
        """The node, which counts as added to its other executor only."""
        return [self._node]

    def can_execute(self, entity: Any) -> bool:
        """As rclpy, but for the subscription alone."""
        return entity is self._subscription and super().can_execute(entity)


def clock_executor(node: Node) -> ClockExecutor | None:
    """An executor that follows the clock of a node; None where it has the time of the machine."""
    subscription = getattr(getattr(node, "_time_source", None), "_clock_sub", None)
    return None if subscription is None else ClockExecutor(node, subscription)


class Spinner:
    """A thread that spins an executor until :meth:`stop`.

    Args:
        executor: the executor.
        on_error: called with the exceptions of callbacks; spinning continues afterwards.
    """

    def __init__(self, executor: Executor, on_error: Callable[[Exception], None]):
        self._executor, self._on_error = executor, on_error
        self._stopped = False
        self._limit = 0.0  # s; limit of the current pause
        self._free = threading.Event()  # not paused
        self._free.set()
        self._thread = threading.Thread(target=self._spin, name="executor", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Accept no more callbacks, wait for running ones, then shut the executor down.

        In the reverse order, as in rclpy, a running callback would use handles that the executor has destroyed.
        """
        self._stopped = True
        self._free.set()
        self._executor.wake()
        self._thread.join()
        if isinstance(self._executor, MultiThreadedExecutor):
            self._executor._executor.shutdown(wait=True)  # its thread pool, which rclpy does not wait for
        self._executor.shutdown()

    @contextmanager
    def paused(self, limit: float):
        """Run no callbacks during a context, but resume after ``limit`` seconds at the latest.

        A computation in this process then does not share the interpreter with the executor. Messages are queued.
        """
        self._limit = limit
        self._free.clear()
        self._executor.wake()
        try:
            yield
        finally:
            self._free.set()

    def _spin(self) -> None:
        # the same function each time: with another one, rclpy drops what else was ready, and waits for it again
        ended = lambda: self._stopped or not self._free.is_set()  # noqa: E731
        while not self._stopped and self._executor.context.ok():
            try:
                if not self._free.wait(self._limit):
                    self._free.set()
                # as spin_until_future_complete, which however adds a callback to the future for each executed callback
                self._executor._spin_once_impl(None, ended)  # type: ignore[attr-defined]
            except ExternalShutdownException:
                return
            except (InvalidHandle, RCLError) as error:
                if isinstance(error, RCLError) and DESTROYED not in str(error):
                    self._on_error(error)
            except Exception as error:
                self._on_error(error)
