"""A node that is killed is noticed and named within seconds, and a second supervisor before it starts."""

import os
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
import rclpy
from action_msgs.srv import CancelGoal
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from hmap import heartbeats
from hmap.environment import ros_environment
from hmap.heartbeats import LEASE, MOTION_LEASE, SETTLED, YOUNG, Heartbeat, runs_already, was_there_before
from hmap.node import HmapNode
from hmap.requests import Caller
from hmap.spinning import Spinner
from hmap.supervision.watchdog import MotionWatchdog
from hmap_core.exceptions import Code, PlannerError
from hmap_msgs.srv import PlanWaypoints

os.environ["ROS_DOMAIN_ID"] = str(120 + os.getpid() % 100)  # each process of tests takes its own
NAMESPACE = "/heartbeats"
ROLE, SERVICE = "waypoint_planner", "plan_waypoints"
LIMIT = 60.0  # s on a busy machine
SOON = 15.0  # s in which a node that has died is named on a busy machine, less than DDS takes
STAND_IN = """
import sys, time
import rclpy
from hmap.heartbeats import offer_heartbeat
from hmap_msgs.srv import PlanWaypoints

def answer(request, response):
    if sys.argv[2] == "hangs":
        time.sleep(600)
    return response

rclpy.init(args=["--ros-args", "-r", "__ns:=/heartbeats"])
node = rclpy.create_node("stand_in")
heartbeat = offer_heartbeat(node, sys.argv[1])
service = node.create_service(PlanWaypoints, "plan_waypoints", answer)
print("up", flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def stand_in():
    """Starts processes that stand in for a node."""
    started = []

    def start(role: str, what: str) -> subprocess.Popen:
        command = [sys.executable, "-c", STAND_IN, role, what]
        process = subprocess.Popen(command, env=ros_environment(), stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout.readline() == "up\n"
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.fixture
def node():
    rclpy.init(args=["--ros-args", "-r", f"__ns:={NAMESPACE}"], signal_handler_options=SignalHandlerOptions.NO)
    node = HmapNode("watching")
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    spinner = Spinner(executor, node.callback_failed)
    yield node
    node.close()
    spinner.stop()
    node.destroy_node()
    rclpy.shutdown()


def until(condition, limit: float = LIMIT) -> None:
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize(("role", "lease"), [("supervisor", MOTION_LEASE), (ROLE, LEASE)])
def test_the_death_of_a_node_is_noticed_within_its_lease(node, stand_in, role, lease, number):
    lost = threading.Event()
    heartbeat = Heartbeat(node, role, node.group, lost.set, lease)
    process = stand_in(role, "answers")
    until(lambda: heartbeat.alive == 1)
    assert not heartbeat.lost
    process.send_signal(number)
    assert lost.wait(10.0 * lease)
    assert heartbeat.lost and heartbeat.alive == 0


def test_several_signs_of_life_can_be_late_before_a_node_counts_as_dead():
    signs = {MOTION_LEASE: heartbeats.SUPERVISOR_PROMISE, LEASE: heartbeats.PROMISE}
    for lease, promise in signs.items():
        assert lease >= 2.0 * promise, "at least two signs in each lease"
    assert MOTION_LEASE + heartbeats.CONFIRM < 0.35, "the rest of 0.5 s is for braking"


def asked(caller, found: list) -> threading.Thread:
    """A request in a thread of its own."""

    def ask() -> None:
        try:
            found.append(caller.ask(PlanWaypoints, SERVICE, PlanWaypoints.Request(), LIMIT))
        except PlannerError as error:
            found.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    return thread


def until_seen(caller) -> None:
    client = caller.client(PlanWaypoints, SERVICE)
    until(lambda: caller._heartbeats[SERVICE].alive == 1 and client.service_is_ready())


def test_a_planner_that_dies_while_it_works_is_named_soon(node, stand_in):
    told, found = [], []
    caller = Caller(node, 1.0, [SERVICE]).until(lambda: False, told.append)
    process = stand_in(ROLE, "hangs")
    until_seen(caller)
    thread = asked(caller, found)
    process.kill()
    thread.join(SOON)
    (error,) = found
    assert error.code is Code.SERVICE_UNAVAILABLE and f"the node '{ROLE}' has died" in error.reason
    assert told == [f"the node '{ROLE}' has died; it gets 1 s to be started anew"]


def test_a_planner_that_is_started_anew_is_asked_again_at_once(node, stand_in):
    told, found = [], []
    caller = Caller(node, LIMIT, [SERVICE]).until(lambda: False, told.append)
    process = stand_in(ROLE, "hangs")
    until_seen(caller)
    thread = asked(caller, found)
    process.kill()
    until(lambda: told)
    stand_in(ROLE, "answers")
    thread.join(LIMIT)
    assert isinstance(found[0], PlanWaypoints.Response)


def test_the_arms_are_told_to_stop_when_the_supervisor_dies(node, stand_in):
    asked, warned = threading.Event(), []
    action = "arm/follow_joint_trajectory"

    def cancel(request, response):
        if not any(request.goal_info.goal_id.uuid):  # all goals
            asked.set()
        return response

    node.create_service(CancelGoal, f"{action}/_action/cancel_goal", cancel, callback_group=node.group)
    watchdog = MotionWatchdog(NAMESPACE, warned.append)
    watchdog.watch([action])
    process = stand_in("supervisor", "answers")
    until(lambda: watchdog._heartbeat.alive == 1 and watchdog._clients[action].service_is_ready())
    assert not asked.is_set()
    process.kill()
    assert asked.wait(10.0 * MOTION_LEASE)
    until(lambda: warned)
    watchdog.close()
    watchdog._stop()  # confirmed by its timer when the watchdog has ended already
    assert warned == [f"no supervisor lives any more; told to stop: {action}"]


def test_a_planner_that_is_not_there_is_named(node):
    with pytest.raises(PlannerError, match=f"is the node '{ROLE}' running"):
        Caller(node, 0.2, [SERVICE]).ask(PlanWaypoints, SERVICE, PlanWaypoints.Request(), LIMIT)


def test_a_second_node_of_a_role_is_noticed_and_one_that_was_killed_is_not(node, stand_in):
    assert not runs_already("supervisor")
    process = stand_in("supervisor", "answers")
    assert runs_already("supervisor", LIMIT)
    process.kill()
    assert not runs_already("supervisor")


class Signs:
    """An executor and a clock: signs of life come and stop at given times."""

    def __init__(self, changes: dict[float, int]):
        self.now, self.alive, self._changes = 0.0, 1, dict(changes)

    def monotonic(self) -> float:
        return self.now

    def spin_once(self, timeout: float) -> None:
        until = self.now + timeout
        at = min((at for at in self._changes if at <= until), default=None)
        self.now = until if at is None else at
        self.alive = self._changes.pop(at, self.alive)


@pytest.mark.parametrize(
    ("changes", "lives"),
    [
        ({}, True),
        ({0.2: 0}, False),
        ({0.2: 0, 0.3: 1}, True),
        ({0.2: 0, 0.2 + SETTLED / 2: 1, 0.8: 0}, False),
        ({0.2 * i: i % 2 for i in range(1, 300)}, False),
    ],
    ids=["lives", "killed", "late sign", "late sign, then killed", "never settles"],
)
def test_a_late_sign_of_life_is_not_a_death(monkeypatch, changes, lives):
    signs = Signs(changes)
    monkeypatch.setattr(heartbeats, "time", signs)
    assert heartbeats._lives(signs, signs) is lives
    assert signs.now <= heartbeats.LONGEST_PROBE + SETTLED


@pytest.mark.parametrize(
    ("since", "now", "before"),
    [
        (None, 100.0, False),
        (0.5, 0.6, False),  # may have been killed a moment ago
        (0.5, 0.6 + 2.0 * LEASE, True),
        (YOUNG + 1.0, 100.0, False),  # the other one is the younger
    ],
)
def test_the_younger_of_two_makes_way(monkeypatch, since, now, before):
    monkeypatch.setattr(heartbeats, "time", SimpleNamespace(monotonic=lambda: now))
    assert was_there_before(SimpleNamespace(since=since), 0.0) is before


@pytest.mark.parametrize(("load", "limit"), [(0.1, 1.5), (2.0, 1.5), (8.0, 6.0), (1000.0, 20.0)])
def test_a_busy_machine_gets_more_time_for_discovery(monkeypatch, load, limit):
    monkeypatch.setattr(heartbeats.os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(heartbeats.os, "cpu_count", lambda: 2)
    assert heartbeats.probe_limit() == limit
