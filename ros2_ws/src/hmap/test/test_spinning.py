"""The thread that runs callbacks: it can be held up for a moment, and ended at any time."""

import threading
import time
from functools import partial
from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from spinning_fixtures import spun_node
from std_msgs.msg import Empty

from hmap.spinning import (
    EVENT_PERIOD,
    InvalidHandle,
    MessageExecutor,
    RCLError,
    Spinner,
    WorkExecutor,
    clock_executor,
    watch,
)

PERIOD = 0.01  # s between two calls
LONG = 60.0  # s; a test that waits so long has failed
QUIET = 0.3  # s in which many calls would come


@pytest.fixture(params=[MessageExecutor, MultiThreadedExecutor, WorkExecutor])
def ticking(request):
    """A spinner, and an event that a timer of its node sets again and again."""
    ticked = threading.Event()
    with spun_node(request.param) as (node, _, spinner):
        node.create_timer(PERIOD, ticked.set)
        yield spinner, ticked


def ticks_again(ticked: threading.Event) -> bool:
    ticked.clear()
    return ticked.wait(LONG)


def falls_quiet(ticked: threading.Event) -> bool:
    """Whether the timer falls silent; calls may be under way, but not many."""
    for _ in range(5):
        ticked.clear()
        if not ticked.wait(QUIET):
            return True
    return False


def test_no_callbacks_are_taken_in_a_pause_and_again_after_it(ticking):
    spinner, ticked = ticking
    for _ in range(3):
        assert ticks_again(ticked)
        with spinner.paused(LONG):
            assert falls_quiet(ticked)
        assert ticks_again(ticked)


def test_a_pause_ends_when_its_time_is_over(ticking):
    spinner, ticked = ticking
    with spinner.paused(QUIET):
        assert all(ticks_again(ticked) for _ in range(10))


def test_a_spinner_ends_in_a_pause(ticking):
    spinner, _ = ticking
    with spinner.paused(LONG):
        pass  # the fixture ends it, perhaps before the pause was noticed


class Destroying:
    """Stands in for an executor that meets an entity which another thread has just destroyed."""

    context = SimpleNamespace(ok=lambda: True)

    def __init__(self, error):
        self.error, self.spun, self.again = error, 0, threading.Event()

    def _spin_once_impl(self, timeout, ended):
        self.spun += 1
        if self.spun == 1:
            raise self.error
        self.again.set()
        self.again.wait(0.01)

    def wake(self):
        pass

    shutdown = wake


@pytest.mark.parametrize(
    "error",
    [
        InvalidHandle("cannot use Destroyable because destruction was requested"),
        RCLError("Failed to add 'rcl_action_server_t' to wait set: action server pointer is invalid"),
    ],
    ids=["event", "action server"],
)
def test_what_is_destroyed_while_it_is_waited_for_is_no_error(error):
    errors, executor = [], Destroying(error)
    spinner = Spinner(executor, errors.append)
    assert executor.again.wait(60.0)
    spinner.stop()
    assert not errors


def test_a_callback_is_handed_to_the_pool_once_however_late_a_thread_begins_it():
    context = Context()
    context.init()
    node = Node("busy", context=context)
    node.create_timer(PERIOD, lambda: None)
    executor = WorkExecutor(2, context=context)
    executor.add_node(node)
    waiting = []
    executor._executor = SimpleNamespace(submit=lambda *work: waiting.append(work))
    until = time.monotonic() + QUIET
    while time.monotonic() < until:
        executor._spin_once_impl(QUIET)
    assert len(waiting) == 1
    work, *arguments = waiting.pop()
    work(*arguments)
    executor._spin_once_impl(LONG)
    assert len(waiting) == 1
    node.destroy_node()
    context.shutdown()


def test_warnings_of_the_middleware_are_looked_at_once_a_second_and_heartbeats_always():
    context = Context()
    context.init()
    node = Node("told", context=context)
    executor = MessageExecutor(context=context)
    plain, watched = (node.create_subscription(Empty, name, lambda _: None, 1) for name in ("plain", "watched"))
    watch(watched)

    def looked_at() -> list[bool]:
        executor._spin_once_impl(0.0)
        return [all(map(executor.can_execute, topic.event_handlers)) for topic in (plain, watched)]

    assert plain.event_handlers and looked_at() == [True, True] and looked_at() == [False, True]
    executor._events_due -= EVENT_PERIOD
    assert looked_at() == [True, True]
    node.destroy_node()
    context.shutdown()


def test_the_clock_is_followed_by_an_executor_of_its_own():
    context = Context()
    context.init(["--ros-args", "-p", "use_sim_time:=true"])
    node = Node("timed", context=context)
    told = node.create_subscription(Empty, "told", lambda _: None, 1)
    clock, others = clock_executor(node), MessageExecutor(context=context)
    others.add_node(node)
    subscriptions = list(node.subscriptions)
    assert told in subscriptions and len(subscriptions) > 1
    assert [each for each in subscriptions if clock.can_execute(each)] == [node._time_source._clock_sub]
    assert [each for each in subscriptions if not others.can_execute(each)] == [node._time_source._clock_sub]
    spinners = [Spinner(executor, lambda error: None) for executor in (clock, others)]
    publisher = node.create_publisher(Clock, "/clock", 1)
    until = time.monotonic() + LONG
    while not node.get_clock().now().nanoseconds:
        assert time.monotonic() < until
        publisher.publish(Clock(clock=Time(sec=7)))
        time.sleep(PERIOD)
    assert node.get_clock().now().nanoseconds == 7 * 10**9
    for spinner in spinners:
        spinner.stop()
    node.destroy_node()
    context.shutdown()


def test_a_node_with_the_time_of_the_machine_needs_no_executor_for_a_clock():
    context = Context()
    context.init()
    node = Node("untimed", context=context)
    assert clock_executor(node) is None
    node.destroy_node()
    context.shutdown()


def test_all_that_is_ready_is_run_after_one_look(monkeypatch):
    context = Context()
    context.init()
    node = Node("busy", context=context)
    ran, looks = [], []
    executor = MessageExecutor(context=context)
    look = executor._wait_for_ready_callbacks
    monkeypatch.setattr(executor, "_wait_for_ready_callbacks", lambda *args: looks.append(len(ran)) or look(*args))
    for k in range(5):
        node.create_guard_condition(partial(ran.append, k)).trigger()
    executor.add_node(node)
    spinner = Spinner(executor, lambda error: None)
    until = time.monotonic() + LONG
    while len(ran) < 5:
        assert time.monotonic() < until
        time.sleep(PERIOD)
    spinner.stop()
    assert not {1, 2, 3, 4}.intersection(looks), "a look for a part of what was ready"
    node.destroy_node()
    context.shutdown()


def test_what_awaits_something_goes_on_afterwards():
    context = Context()
    context.init()
    executor = WorkExecutor(2, context=context)
    future, ended = Future(executor=executor), threading.Event()

    async def wait() -> None:
        await future
        ended.set()

    spinner = Spinner(executor, lambda error: None)
    executor.create_task(wait)
    assert not ended.wait(QUIET)
    future.set_result(None)
    assert ended.wait(LONG)
    spinner.stop()
    context.shutdown()
