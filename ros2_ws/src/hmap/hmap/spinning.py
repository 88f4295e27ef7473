"""Spins an executor in a thread, and stops it in an order that is safe for running callbacks."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from rclpy.action import ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup
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
from rclpy.task import Future, Task

from hmap.wait_set import GUARD, KINDS, TIMER, KeptWaitSet

EVENT_PERIOD = 1.0  # s
WATCHED = "hmap_watched"  # attribute of event handlers that are looked at all the time
APART = "hmap_apart"  # attribute of a subscription that has an executor of its own
FOLLOWS = "follows"  # instead of the entity of a task: what is done once a future is done, which does not wait
SHORT = (Subscription, Client, ActionClient, EventHandler)  # entities whose callbacks do not wait
InvalidHandle, RCLError = rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError
Ready = tuple[Task, Any, Node | None]  # a callback, and whose it is
# in the error where an action server was destroyed while it was waited for; rclpy ignores that of other entities
DESTROYED = "to wait set"


class _Looks(Executor):
    """Looks for callbacks as rclpy does, at less cost.

    - The wait set is kept, see :class:`hmap.wait_set.KeptWaitSet`.
    - rclpy makes two event handlers for each publisher and subscription, to warn of others that do not fit. They are
      looked at once in EVENT_PERIOD, but for those that :func:`watch` names. Events wait until they are looked at.
    - Callbacks that do not wait run in the thread that spins, as does what follows on a response. This thread looks
      again afterwards without being woken.
    """

    def __init__(self, *arguments: Any, **options: Any):
        super().__init__(*arguments, **options)
        self._kept: dict[bool, KeptWaitSet] = {}  # with and without events
        self._events_due, self._with_events = 0.0, True  # s of the steady clock; whether this look is one of them
        self._spins: int | None = None  # identity of the thread that spins

    def can_execute(self, entity: Any) -> bool:
        """Whether an entity is looked at, unless it is busy."""
        rare = isinstance(entity, EventHandler) and not getattr(entity, WATCHED, False)
        return (self._with_events or not rare) and not getattr(entity, APART, False)

    def create_task(self, callback: Any, *arguments: Any, **options: Any) -> Task:
        """As rclpy."""
        task = Task(callback, arguments, options, executor=self)
        follows = len(arguments) == 1 and isinstance(arguments[0], Future)  # what follows on a response, or a result
        with self._tasks_lock:
            self._tasks.append((task, FOLLOWS if follows else None, None))
        if threading.get_ident() != self._spins:
            self.wake()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """As rclpy."""
        self._kept.clear()
        return super().shutdown(timeout_sec)

    def _spin_once_impl(self, timeout_sec: Any = None, wait_condition: Callable[[], bool] = lambda: False) -> None:
        self._spins, now = threading.get_ident(), time.monotonic()
        self._with_events = now >= self._events_due
        if self._with_events:
            self._events_due = now + EVENT_PERIOD
        try:
            ready: Ready = self.wait_for_ready_callbacks(timeout_sec, None, wait_condition)
        except (ExternalShutdownException, ShutdownException, TimeoutException, ConditionReachedException):
            return
        self._start(ready)

    def _start(self, ready: Ready) -> None:
        """Run a callback in this thread."""
        handler = ready[0]
        handler()
        self._keep(ready)
        handler.result()  # raises its exception

    def _keep(self, ready: Ready) -> None:
        """Go on later with a callback that awaits something."""
        if not ready[0].done():
            with self._tasks_lock:
                self._tasks.append(ready)
            self.wake()

    def _here(self, entity: Any) -> bool:
        """Whether callbacks of an entity run in the thread that spins."""
        return True

    def _wait_for_ready_callbacks(  # type: ignore[override]
        self, timeout_sec: Any = None, nodes: Any = None, condition: Callable[[], bool] = lambda: False
    ) -> Iterator[Ready]:
        until = float("inf") if timeout_sec is None or timeout_sec < 0.0 else time.monotonic() + timeout_sec
        while not self._is_shutdown and not condition():
            with self._tasks_lock:
                tasks, self._tasks = self._tasks, []
            yield from tasks
            if tasks:
                return
            found = False
            for kind, entity in self._look(until):
                handler = self._handler(kind, entity)
                if handler is not None:
                    found = True
                    yield handler, entity, None
            if found:
                return
            if time.monotonic() >= until:
                raise TimeoutException
        raise ShutdownException if self._is_shutdown else ConditionReachedException

    def _look(self, until: float) -> list[tuple[str, Any]]:
        """Wait until something is ready, or until a time (s of the steady clock); kind and entity of what is."""
        nodes, kept = self.get_nodes(), self._kept.get(self._with_events)
        try:
            if kept is None or not kept.is_current(nodes):
                kept = KeptWaitSet(nodes, self._context, (self._guard, self._sigint_gc), self.can_execute)
                self._kept[self._with_events] = kept
            left = until - time.monotonic()
            ready = kept.wait(-1 if left == float("inf") else max(0, int(left * 1e9)))
        except InvalidHandle:
            self._kept.clear()
            raise
        if self._is_shutdown:
            raise ShutdownException
        if not self._context.ok():
            raise ExternalShutdownException
        return ready

    def _handler(self, kind: str, entity: Any) -> Task | None:
        """The callback of an entity that is ready, which is taken; None if there is nothing to do."""
        group, here = entity.callback_group, self._here(entity)
        if not group.beginning_execution(entity):
            if kind == GUARD:  # a look ends its trigger
                entity.trigger()
            return None
        called = None
        try:
            called = getattr(self, f"_take_{kind}")(entity)
        finally:
            if called is None:
                group.ending_execution(entity)
        if called is None:
            return None
        entity._executor_event = busy = kind == TIMER and not here  # its time can come again before it is called

        async def run() -> None:
            if busy:
                entity._executor_event = False
                self.wake()
            try:
                await called()
            finally:
                group.ending_execution(entity)
                if not here and not isinstance(group, ReentrantCallbackGroup):
                    self.wake()  # others of the group are no longer kept

        return Task(run, executor=self)


def watch(subscription: Subscription) -> None:
    """Have executors call back at once when the middleware tells something of a subscription."""
    handlers: Any = subscription.event_handlers
    for handler in handlers:
        setattr(handler, WATCHED, True)


class MessageExecutor(_Looks, SingleThreadedExecutor):
    """Runs callbacks, none of which waits, in the thread that spins."""


class WorkExecutor(_Looks, MultiThreadedExecutor):
    """Runs callbacks in a pool of threads, since some wait, but those that do not wait in the thread that spins.

    A message then costs neither a change of threads nor another look at everything that the node waits for.
    """

    def _here(self, entity: Any) -> bool:
        return entity is FOLLOWS or isinstance(entity, SHORT)

    def _start(self, ready: Ready) -> None:
        if self._here(ready[1]):
            super()._start(ready)
            return
        self._executor.submit(self._work, ready)
        self._futures.append(ready[0])
        for future in [future for future in self._futures if future.done()]:
            self._futures.remove(future)
            future.result()

    def _work(self, ready: Ready) -> None:
        """Run a callback in the pool."""
        ready[0]()
        self._keep(ready)


class ClockExecutor(_Looks, SingleThreadedExecutor):
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
        setattr(subscription, APART, True)
        group = subscription.callback_group = ReentrantCallbackGroup()  # parameter services do not keep the clock
        group.add_entity(subscription)
        self._subscription, others = subscription, dict.fromkeys(KINDS.values(), ())
        self._alone: Any = SimpleNamespace(**others | {"subscriptions": (subscription,)})

    def get_nodes(self) -> list[Node]:
        """What is looked at; the node counts as added to its other executor only."""
        return [self._alone]

    def can_execute(self, entity: Any) -> bool:
        """Whether an entity is looked at."""
        return entity is self._subscription


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
