"""Executors keep their wait sets, and see all the same what comes, goes, and is busy."""

import threading
import time

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.node import Node
from rclpy.task import Future
from spinning_fixtures import spun_node
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from hmap import spinning
from hmap.spinning import MessageExecutor, Spinner, WorkExecutor

LONG = 60.0  # s; a test that waits so long has failed
QUIET = 0.3  # s in which a callback would come
PERIOD = 0.01  # s between two tries


@pytest.fixture(params=[MessageExecutor, WorkExecutor])
def spun(request):
    """A node that an executor spins, and the executor."""
    with spun_node(request.param) as (node, executor, _):
        yield node, executor


def comes(publisher, came: threading.Event) -> bool:
    """Whether a message arrives."""
    came.clear()
    until = time.monotonic() + LONG
    while not came.wait(PERIOD) and time.monotonic() < until:
        publisher.publish(Empty())
    return came.is_set()


def test_entities_that_come_and_go_are_noticed(spun):
    node, _ = spun
    publisher, first, second = node.create_publisher(Empty, "news", 1), threading.Event(), threading.Event()
    subscription = node.create_subscription(Empty, "news", lambda _: first.set(), 1)
    assert comes(publisher, first)
    node.create_subscription(Empty, "news", lambda _: second.set(), 1)
    assert comes(publisher, second)
    node.destroy_subscription(subscription)
    assert comes(publisher, second)
    first.clear()
    assert comes(publisher, second) and not first.wait(QUIET)


def test_the_wait_set_is_made_once_for_the_same_entities(spun, monkeypatch):
    node, _ = spun
    publisher, came, made = node.create_publisher(Empty, "news", 1), threading.Event(), []
    node.create_subscription(Empty, "news", lambda _: came.set(), 1)
    assert comes(publisher, came)
    kept = spinning.KeptWaitSet
    monkeypatch.setattr(spinning, "KeptWaitSet", lambda *given: made.append(given) or kept(*given))
    monkeypatch.setattr(spinning, "EVENT_PERIOD", LONG)
    for _ in range(20):
        assert comes(publisher, came)
    assert len(made) <= 1  # with what the middleware tells


@pytest.mark.parametrize("group", [ReentrantCallbackGroup, MutuallyExclusiveCallbackGroup])
def test_services_wait_in_the_pool_and_those_of_an_exclusive_group_for_each_other(group):
    context = Context()
    context.init()
    node = Node("serving", context=context)
    executor, asking = WorkExecutor(4, context=context), WorkExecutor(2, context=context)
    begun, free, served_by = threading.Semaphore(0), threading.Event(), group()

    def answer(_, response):
        begun.release()
        free.wait(LONG)
        return response

    names = ("one", "other")
    for name in names:
        node.create_service(Trigger, name, answer, callback_group=served_by)
    asker = Node("asking", context=context)
    clients = [asker.create_client(Trigger, name) for name in names]
    executor.add_node(node)
    asking.add_node(asker)
    spinners = [Spinner(each, lambda error: None) for each in (executor, asking)]
    assert all(client.wait_for_service(LONG) for client in clients)
    answered = threading.Semaphore(0)
    for client in clients:
        client.call_async(Trigger.Request()).add_done_callback(lambda _: answered.release())
    assert begun.acquire(timeout=LONG)
    assert begun.acquire(timeout=LONG if group is ReentrantCallbackGroup else QUIET) is (
        group is ReentrantCallbackGroup
    )
    free.set()
    assert all(answered.acquire(timeout=LONG) for _ in clients)
    for spinner in spinners:
        spinner.stop()
    for each in (node, asker):
        each.destroy_node()
    context.shutdown()


def test_what_follows_on_a_response_runs_in_the_thread_that_spins(spun):
    _, executor = spun
    future, threads, told = Future(executor=executor), [], threading.Event()
    future.add_done_callback(lambda _: (threads.append(threading.current_thread().name), told.set()))
    future.set_result(None)
    assert told.wait(LONG) and threads == ["executor"]


def test_a_task_that_a_callback_makes_is_run(spun):
    node, executor = spun
    ran, publisher, came = threading.Event(), node.create_publisher(Empty, "news", 1), threading.Event()
    node.create_subscription(Empty, "news", lambda _: (executor.create_task(ran.set), came.set()), 1)
    assert comes(publisher, came) and ran.wait(LONG)
