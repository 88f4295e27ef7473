"""What the planners' services answer reaches Algorithm 1 as it would from a direct call, failures included."""

from dataclasses import replace

import numpy as np
import pytest
from services import Serving

from hmap.conversions import state_from_message, state_to_message
from hmap.phase_conversions import path_to_response
from hmap.remote_components import (
    MAX_SEED,
    RosContactChecker,
    RosContactFinder,
    RosObjectPathPlanner,
    remote_components,
)
from hmap_core.kinematics.arm import load_arm
from hmap_core.plan_file import to_dict
from hmap_core.planner import ContactQuery, ObjectPathQuery, plan
from hmap_core.planner.components import proposers
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.segments import attach_body
from hmap_core.scenes import load_scene
from hmap_core.transforms import multiply, pose
from hmap_core.types import BodyKind, ContactKind, ContactPoint
from hmap_core.validation import check
from hmap_core.waypoints import NoObjectPath, ObjectPath
from hmap_msgs.srv import PlanWaypoints
from hmap_msgs_py.errors import error_to_message

PLANNING = 120.0  # s on a busy machine
PUSH_OUT = """
schema: 1
description: Push a box out of a tunnel with a stick.
mode: physical
motion: planar
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, 0]}}
  left: {shape: box, size: [0.30, 0.03, 0.10], pose: {xyz: [0.0, 0.455, 0.10]}}
  right: {shape: box, size: [0.30, 0.03, 0.10], pose: {xyz: [0.0, 0.345, 0.10]}}
  roof: {shape: box, size: [0.30, 0.14, 0.03], pose: {xyz: [0.0, 0.40, 0.165]}}
movable:
  crate: {shape: box, size: [0.10, 0.06, 0.06], pose: {xyz: [0.03, 0.40, 0.08]}, mass: 0.2, friction: 0.5}
tools:
  stick: {shape: box, size: [0.40, 0.04, 0.04], pose: {xyz: [0.40, 0.25, 0.07]}, mass: 0.2}
  cube: {shape: box, size: [0.05, 0.05, 0.05], pose: {xyz: [0.30, 0.10, 0.075]}, mass: 0.1}
robots:
  arm: {model: panda, base: {xyz: [0.3, -0.2, 0.05], rpy_deg: [0, 0, 90]}}
goal: {object: crate, pose: {xyz: [-0.10, 0.40, 0.08]}}
"""


class Answering:
    """Stands in for the caller of services; every call has the same response."""

    def __init__(self, response):
        self._response = response

    def ask(self, service, name, request, limit):
        return self._response


def asked(response) -> NoObjectPath:
    scene = load_scene("tunnel", 0)
    with pytest.raises(NoObjectPath) as error:
        RosObjectPathPlanner(Answering(response)).plan_path(
            ObjectPathQuery(scene, scene.start_state(), scene.goal, 0, 1.0)
        )
    return error.value


def blocked() -> PlanWaypoints.Response:
    response = PlanWaypoints.Response(blocking=["crate"], removal_known=True, free_without=["crate"])
    response.error = error_to_message(NoObjectPath("'crate' is in the way", ("crate",), ("crate",)))
    return response


def test_what_blocks_and_the_path_without_it_come_over_the_service():
    poses = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (4, 1))
    poses[:, 0] = np.linspace(0.1, 0.4, 4)
    response = blocked()
    path_to_response(ObjectPath(poses, np.array([3]), np.full(4, 0.05), "planar"), "bar", response)
    error = asked(response)
    assert error.free_without == error.blockers == ("crate",)
    np.testing.assert_array_equal(error.path_without.poses, poses)
    assert error.path_without.motion == "planar"


def test_without_a_path_in_the_answer_there_is_none():
    error = asked(blocked())
    assert error.free_without == ("crate",) and error.path_without is None


@pytest.fixture(scope="module")
def pushed_out(tmp_path_factory):
    """A plan made over services for a task that needs a tool, and who served them."""
    file = tmp_path_factory.mktemp("push_out") / "push_out.yaml"
    file.write_text(PUSH_OUT)
    caller = Serving()
    return plan(load_scene(str(file)), seed=1, components=remote_components(caller), time_limit=PLANNING), caller


def test_a_tool_is_picked_used_and_placed_over_services(pushed_out):
    found, _ = pushed_out
    assert check(to_dict(found)).valid
    assert [s.object for s in found.segments if s.manipulator == "stick"] == ["crate"]
    way = found.trajectory.objects["stick"]
    assert np.abs(way - way[0]).max() > 0.1
    np.testing.assert_allclose(way[-1], way[0], atol=1e-3)


class Ranker:
    """Ranks hands and holds, and proposes nothing."""

    name = "told"

    def propose(self, query):
        return iter(())

    def hand_serves(self, scene, state, object, object_poses, robots):
        return np.ones(len(robots))

    def hold_serves(self, scene, state, object, object_poses, holds):
        return np.ones(len(holds)), np.ones(len(holds))


def test_a_ranker_orders_tools_and_holds_although_contacts_come_from_a_node():
    ranker = Ranker()
    parts = remote_components(Serving(), ranker)
    assert parts.ranker is ranker and parts.tools._ranker is ranker
    assert isinstance(parts.contacts, RosContactFinder)
    assert remote_components(Serving()).ranker is None


def test_contacts_are_checked_where_they_are_proposed_and_counted(pushed_out):
    _, caller = pushed_out
    assert "check_contacts" not in caller.called and caller.sampled > 0


def test_the_service_checks_as_the_local_checker_does(tmp_path):
    """With the same seed of the inverse kinematics, and with contacts that serve too short left out."""
    file = tmp_path / "push_out.yaml"
    file.write_text(PUSH_OUT)
    scene = load_scene(str(file))
    state, poses = scene.start_state(), np.tile(scene.bodies["stick"].pose, (3, 1))
    poses[:, 2] += [0.0, 0.01, 0.0]
    query = ContactQuery(scene, state, "stick", poses, "arm", np.random.default_rng(0))
    contacts = next(iter(proposers(None)[0].propose(query))).contacts
    remote, seed = RosContactChecker(Serving()), int(np.random.default_rng(1).integers(MAX_SEED))
    there = remote.check(replace(query, rng=np.random.default_rng(1)), contacts)
    here = LocalContactChecker().check(replace(query, rng=np.random.default_rng(seed)), contacts)
    assert here and [contact.reach for contact in there] == [contact.reach for contact in here]
    for a, b in zip(there, here, strict=True):
        np.testing.assert_allclose(a.keyframes, b.keyframes, atol=1e-9)
    assert remote.check(query, contacts, beyond=2) == []


def test_what_a_robot_holds_is_where_its_hand_is():
    scene = load_scene("tunnel_tool", 0)
    state = scene.start_state()
    robot = next(iter(scene.robots))
    tool = next(name for name, body in scene.bodies.items() if body.kind is BodyKind.TOOL)
    T_tool_ee = pose((0.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0))
    grip = ContactPoint(ContactKind.GRASP, T_tool_ee, np.zeros(3), np.eye(3)[1], 0.02, np.eye(3)[2])
    attached = attach_body(scene, robot, tool, grip, state.poses[tool])
    arrived = state_from_message(attached, state_to_message(attached, state))
    placed = scene.robots[robot]
    T_world_ee = multiply(placed.base_pose, load_arm(placed.model).end_effector(state.q[robot]))
    np.testing.assert_allclose(multiply(arrived.poses[tool], T_tool_ee), T_world_ee, atol=1e-9)
