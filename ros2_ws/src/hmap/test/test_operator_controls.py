"""What an operator asks for changes the pace, ends goals, and is refused with a reason where there is nothing to do."""

import threading
from types import SimpleNamespace

import pytest
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from hmap import operator_client
from hmap.supervision import operator_controls as module
from hmap.supervision.operator_controls import OperatorControls
from hmap_core.exceptions import Code, InputError, PlannerError


class Node:
    """What the controls need of a node; keeps what they offer."""

    group = None

    def __init__(self, **parameters):
        self.parameters, self.services, self.topics = parameters, {}, {}

    def parameter(self, name, default, *_):
        return self.parameters.get(name, default)

    def subscribe(self, _, topic, callback):
        self.topics[topic] = callback

    def create_service(self, _, name, answer, callback_group):
        self.services[name] = answer

    def get_logger(self):
        return SimpleNamespace(info=lambda text: None)

    def get_name(self):
        return "supervisor"

    def call(self, name: str) -> tuple[bool, str]:
        response = self.services[f"~/{name}"](Trigger.Request(), Trigger.Response())
        return response.success, response.message


def controls(goal: bool = True, **parameters):
    node, changes = Node(**parameters), []
    return node, OperatorControls(node, lambda: goal, lambda: changes.append(True)), changes


def test_pause_resume_and_stop():
    node, operator, changes = controls()
    assert node.call("resume") == (False, "nothing is paused")
    assert node.call("pause")[0] and operator.pace.paused and operator.pace.rate == 0.0
    assert node.call("stop")[0] and operator.stops == 1
    assert operator.pace.paused, "a pause outlives the goal"
    assert node.call("resume")[0] and operator.pace.rate == 1.0 and len(changes) == 3


def test_without_a_goal_there_is_nothing_to_stop():
    node, operator, _ = controls(goal=False)
    assert node.call("stop") == (False, "no goal is being worked on; nothing moves") and operator.stops == 0


def test_scales_come_by_parameter_and_by_topic():
    node, operator, _ = controls(speed_scaling=0.5)
    assert operator.pace.rate == 0.5
    node.topics["speed_scaling"](Float64(data=0.2))
    node.topics["acceleration_scaling"](Float64(data=0.01))
    assert operator.pace.rate == pytest.approx(0.1)
    with pytest.raises(InputError, match="speed_scaling = 2.0: it has to be above 0 and at most 1"):
        node.topics["speed_scaling"](Float64(data=2.0))
    with pytest.raises(InputError, match="speed_scaling = 0.0"):
        controls(speed_scaling=0.0)


def test_the_first_motion_waits_for_a_confirmation(monkeypatch):
    monkeypatch.setattr(module, "POLL", 0.01)
    node, operator, _ = controls(confirm_motion=True)
    assert node.call("confirm") == (False, "no motion waits for a confirmation")
    told, asked = [], threading.Event()

    def tell(text: str) -> None:
        told.append(text)
        asked.set()

    thread = threading.Thread(target=operator.wait_for_confirmation, args=(lambda: False, tell))
    thread.start()
    assert asked.wait(10.0) and node.call("confirm")[0]
    thread.join(10.0)
    assert not thread.is_alive() and "supervisor/confirm" in told[0]
    with pytest.raises(PlannerError) as error:
        operator.wait_for_confirmation(lambda: True, told.append)
    assert error.value.code is Code.CANCELED


def test_without_the_parameter_nothing_waits():
    _, operator, _ = controls()
    operator.wait_for_confirmation(lambda: False, pytest.fail)


class LosingClient:
    """Stands in for a client of which the middleware loses the first request."""

    def __init__(self):
        self.sent, self.forgotten = [], 0

    def wait_for_service(self, _) -> bool:
        return True

    def call_async(self, _):
        self.sent.append(Future())
        if len(self.sent) == 2:
            self.sent[-1].set_result(Trigger.Response(success=True, message="motions go on"))
        return self.sent[-1]

    def remove_pending_request(self, _) -> None:
        self.forgotten += 1


@pytest.mark.parametrize(("repeat", "limit"), [(0.05, 60.0), (60.0, 0.1)])
def test_a_request_of_an_operator_that_is_lost_is_sent_again(monkeypatch, repeat, limit):
    monkeypatch.setattr(operator_client, "REPEAT", repeat)
    monkeypatch.setattr(operator_client, "LIMIT", limit)
    losing = LosingClient()
    node = SimpleNamespace(create_client=lambda *_: losing, create_publisher=lambda *_: None)
    client = operator_client.OperatorClient(node)
    if repeat < limit:
        assert client.call("resume") == (True, "motions go on")
        assert len(losing.sent) == losing.forgotten == 2
    else:
        with pytest.raises(PlannerError, match="has not answered"):
            client.call("resume")
