"""Managed nodes work while they are active, and say in which state they are where they do not."""

import time

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from hmap.lifecycle import ManagedNode
from hmap.nodes.contact_proposer import ContactProposerNode
from hmap.nodes.komo_optimiser import KomoOptimiser
from hmap.nodes.supervisor import Supervisor
from hmap.nodes.waypoint_planner import WaypointPlanner
from hmap.spinning import MessageExecutor, Spinner
from hmap_core.exceptions import Code
from hmap_msgs.srv import LoadScene

LIMIT = 30.0  # s on a busy machine
DOMAIN = 83


class Loader(ManagedNode):
    """Counts requests; is settled unless it is told otherwise."""

    def __init__(self):
        super().__init__("loader")
        self.requests, self.can_end = 0, True
        self.serve(LoadScene, "load", self._load)

    def _load(self, request, response):
        self.requests += 1

    def settled(self) -> bool:
        return self.can_end


@pytest.fixture
def loader(request):
    """A node that spins, and how to ask it."""
    given = ["-p", "autostart:=false"] if getattr(request, "param", "") == "waits" else []
    rclpy.init(args=["--ros-args", *given], domain_id=DOMAIN)
    node = Loader()
    client = rclpy.create_node("client", use_global_arguments=False)
    spinners = []
    for each in (node, client):
        executor = MessageExecutor()
        executor.add_node(each)
        spinners.append(Spinner(executor, lambda error: None))
    node.started()

    def ask(kind, name, request):
        service = client.create_client(kind, name)
        assert service.wait_for_service(LIMIT)
        future, until = service.call_async(request), time.monotonic() + LIMIT
        while not future.done():
            assert time.monotonic() < until, "no answer"
            time.sleep(0.01)
        return future.result()

    yield node, ask
    node.close()
    for spinner in spinners:
        spinner.stop()
    for each in (node, client):
        each.destroy_node()
    rclpy.shutdown()


def change(ask, transition: int) -> bool:
    return ask(ChangeState, "loader/change_state", ChangeState.Request(transition=Transition(id=transition))).success


def state(ask) -> str:
    return ask(GetState, "loader/get_state", GetState.Request()).current_state.label


def load(ask):
    return ask(LoadScene, "load", LoadScene.Request()).error


def test_a_node_is_active_at_once_and_refuses_work_while_it_is_not(loader):
    node, ask = loader
    assert state(ask) == "active" and load(ask).code == 0
    assert change(ask, Transition.TRANSITION_DEACTIVATE) and state(ask) == "inactive"
    error = load(ask)
    assert (
        error.code == Code.SERVICE_UNAVAILABLE
        and "the node /loader is inactive: `ros2 lifecycle set /loader activate`" in error.reason
    )
    assert node.requests == 1 and node._status[1] == "inactive"
    assert change(ask, Transition.TRANSITION_ACTIVATE) and load(ask).code == 0


@pytest.mark.parametrize("loader", ["waits"], indirect=True)
def test_a_node_that_does_not_start_by_itself_waits_for_both_transitions(loader):
    node, ask = loader
    assert (
        state(ask) == "unconfigured" and "is unconfigured: `ros2 lifecycle set /loader configure`" in load(ask).reason
    )
    assert change(ask, Transition.TRANSITION_CONFIGURE) and load(ask).code == Code.SERVICE_UNAVAILABLE
    assert change(ask, Transition.TRANSITION_ACTIVATE) and load(ask).code == 0 and node.requests == 1
    assert change(ask, Transition.TRANSITION_ACTIVE_SHUTDOWN) and "is finalized: start it anew" in load(ask).reason


def test_what_a_state_does_not_allow_is_refused_and_answered(loader):
    node, ask = loader
    assert not change(ask, Transition.TRANSITION_CONFIGURE) and state(ask) == "active"
    node.can_end = False  # as a supervisor whose arms do not come to rest
    assert not change(ask, Transition.TRANSITION_DEACTIVATE) and state(ask) == "active" and load(ask).code == 0


def test_the_planning_nodes_and_the_supervisor_are_managed():
    for kind in (Supervisor, WaypointPlanner, ContactProposerNode, KomoOptimiser):
        assert issubclass(kind, ManagedNode)
