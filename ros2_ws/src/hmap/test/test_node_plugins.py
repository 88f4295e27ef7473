"""The nodes use the parts that their parameters name, also those of other packages."""

import sys

import numpy as np
import pytest
import rclpy

from hmap.conversions import scene_to_message, state_to_message
from hmap.node import BAD_INPUT, run
from hmap.nodes.contact_proposer import ContactProposerNode
from hmap.nodes.supervisor import Supervisor
from hmap.nodes.waypoint_planner import WaypointPlanner
from hmap_core.scenes import load_scene
from hmap_msgs.srv import PlanWaypoints, ProposeContacts
from hmap_msgs_py.poses import pose_to_message, poses_to_messages

TIME_LIMIT = 600.0  # s on a busy machine
MODULE = """
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.sampled_contacts import SampledContacts

used = []


class Noted(SampledContacts):
    def propose(self, query):
        used.append(query.object)
        yield from super().propose(query)


class Straight:
    def __init__(self, label=""):
        self.label = label

    def plan_path(self, query):
        used.append(self.label)
        return BidirectionalSearch().plan_path(query)
"""
ENTRY_POINTS = """
[hmap.contact_proposers]
noted = parts_for_nodes:Noted

[hmap.object_path_planners]
straight = parts_for_nodes:Straight
"""


@pytest.fixture
def used(tmp_path, monkeypatch):
    """The other package is installed; what its parts have been used for."""
    (tmp_path / "parts_for_nodes.py").write_text(MODULE)
    info = tmp_path / "parts_for_nodes-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: parts-for-nodes\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    import parts_for_nodes

    yield parts_for_nodes.used
    sys.modules.pop("parts_for_nodes", None)


@pytest.fixture
def started():
    """Starts nodes with parameters, as the command line gives them."""
    nodes = []

    def start(kind, **parameters):
        given = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
        rclpy.init(args=["--ros-args", *given])
        nodes.append(kind())
        return nodes[-1]

    yield start
    for node in nodes:
        node.close()
        node.destroy_node()
    rclpy.try_shutdown()


def request(kind, scene, state, **fields):
    message = kind.Request(object=scene.goal.object, time_limit=TIME_LIMIT, **fields)
    message.scene, message.world = scene_to_message(scene), state_to_message(scene, state)
    return message


def test_the_contact_proposer_uses_a_proposer_of_another_package(used, started):
    scene = load_scene("bolt", 0)
    state, name = scene.start_state(), scene.goal.object
    poses = np.tile(state.poses[name], (2, 1))
    node = started(ContactProposerNode, proposer="noted")
    response = ProposeContacts.Response()
    node._propose(request(ProposeContacts, scene, state, object_poses=poses_to_messages(poses)), response)
    assert set(used) == {name}
    assert response.contacts and response.sampled >= len(response.contacts)


def test_the_waypoint_planner_uses_a_path_planner_of_another_package(used, started):
    scene = load_scene("bolt", 0)
    node = started(WaypointPlanner, object_path_planner="straight:far")
    response = PlanWaypoints.Response()
    goal = pose_to_message(scene.goal.pose, "goal")
    node._plan(request(PlanWaypoints, scene, scene.start_state(), goal=goal), response)
    assert used == ["far"] and len(response.path.poses) > 7


def test_a_name_that_is_unknown_ends_the_node_with_its_reason(capfd):
    code = run(ContactProposerNode, ["--ros-args", "-p", "proposer:=learnt"])
    assert code == BAD_INPUT
    assert "unknown contact proposer 'learnt'; there are" in capfd.readouterr().err


def test_the_supervisor_has_one_parameter_for_the_contact_proposer(capfd):
    assert run(Supervisor, ["--ros-args", "-p", "planner:=hmap:learned"]) == BAD_INPUT
    assert "'planner' is 'hmap:learned'; name the proposer by 'proposer' instead" in capfd.readouterr().err
