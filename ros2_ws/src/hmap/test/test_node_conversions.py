"""The planner's types survive the way over messages; what does not belong to the scene is refused."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from hmap import conversions as convert
from hmap import phase_conversions as phases
from hmap.requests import scene_and_state
from hmap_core import plan_file, transforms
from hmap_core.exceptions import Code, HmapError, InputError
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.scenes import load_scene
from hmap_core.types import ContactKind, ContactPoint, Plan, Segment, SegmentKind, Trajectory
from hmap_core.waypoints import ObjectPath
from hmap_msgs.msg import Scene
from hmap_msgs.srv import CheckContacts, PlanWaypoints, ProposeContacts, SolveSegment
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.errors import error_to_message

EXACT = 1e-12
ROUNDED = 1e-8  # scenes and plans travel as text with 9 decimals


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 3)


@pytest.fixture
def contact():
    T = transforms.pose((0.1, 0.0, 0.02), (1.0, 0.0, 0.0, 0.0))
    up, down = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    point = ContactPoint(ContactKind.GRASP, T, np.array([0.1, 0.0, 0.03]), up, 0.06, down, 1.5)
    return RobotContact("panda_2", point, 2, np.arange(21.0).reshape(3, 7), ("panda_1",))


@pytest.fixture
def trajectory(scene):
    n = 5
    joints = {name: np.linspace(0.0, 0.1, n)[:, None] + robot.q for name, robot in scene.robots.items()}
    gripper = {name: np.linspace(0.08, 0.06, n) for name in scene.robots}
    return Trajectory(
        np.arange(n) * 0.02, joints, gripper, {"bar": np.repeat(scene.bodies["bar"].pose[None], n, axis=0)}
    )


def segments():
    T = transforms.pose((0.1, 0.0, 0.0))
    return (
        Segment(0.0, 0.04, "panda_1", "panda_hand", None, SegmentKind.TRANSIT),
        Segment(0.04, 0.08, "panda_1", "panda_hand", "bar", SegmentKind.GRASP, T),
    )


def equal(a, b, tolerance=EXACT) -> bool:
    """Whether two values of the planner's types are the same."""
    if hasattr(a, "__dataclass_fields__"):
        return all(equal(getattr(a, f.name), getattr(b, f.name), tolerance) for f in fields(a))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[k], b[k], tolerance) for k in a)
    if isinstance(a, list | tuple) and not isinstance(a, str):
        return len(a) == len(b) and all(equal(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray | float):
        return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=0.0, atol=tolerance)
    return a == b


def test_scene(scene):
    assert equal(convert.scene_from_message(convert.scene_to_message(scene)), scene, ROUNDED)


def test_state(scene):
    state = scene.start_state()
    state.q["panda_1"] += 0.1
    state.gripper["panda_2"] = 0.03
    state.poses["bar"] = transforms.pose((0.1, 0.2, 0.3))
    assert equal(convert.state_from_message(scene, convert.state_to_message(scene, state)), state)


def test_joints_of_a_state_are_matched_by_name(scene):
    message = convert.state_to_message(scene, scene.start_state())
    message.robots[0].joint_names = list(reversed(message.robots[0].joint_names))
    message.robots[0].position = list(reversed(message.robots[0].position))
    name = message.robots[0].name
    assert np.allclose(convert.state_from_message(scene, message).q[name], scene.robots[name].q)


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda m: setattr(m, "robots", m.robots[:1]), Code.UNKNOWN_ROBOT),
        (lambda m: setattr(m, "bodies", m.bodies[1:]), Code.UNKNOWN_OBJECT),
        (lambda m: setattr(m.bodies[0], "name", "nix"), Code.UNKNOWN_OBJECT),
        (lambda m: m.robots[0].position.__setitem__(0, float("nan")), Code.INVALID_INPUT),
        (lambda m: setattr(m.robots[0], "position", [0.0]), Code.INVALID_INPUT),
        (lambda m: setattr(m.bodies[0].pose.orientation, "w", 3.0), Code.INVALID_POSE),
        (lambda m: setattr(m.bodies[0].pose.position, "x", float("inf")), Code.INVALID_POSE),
    ],
)
def test_wrong_states_are_refused(scene, spoil, code):
    message = convert.state_to_message(scene, scene.start_state())
    spoil(message)
    with pytest.raises((HmapError, ConversionError)) as caught:
        convert.state_from_message(scene, message)
    assert error_to_message(caught.value).code == code


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: setattr(m.robots[0], "velocity", [float("nan")] * 7),
        lambda m: setattr(m.robots[0], "velocity", [0.0]),
        lambda m: setattr(m.robots[0].base_pose.orientation, "w", 5.0),
        lambda m: setattr(m.bodies[0], "mass", float("nan")),
        lambda m: setattr(m.bodies[0].color, "r", float("inf")),
        lambda m: setattr(m.bodies[0], "shapes", []),
    ],
)
def test_what_a_state_does_not_need_is_not_judged(scene, spoil):
    message = convert.state_to_message(scene, scene.start_state())
    spoil(message)
    assert equal(convert.state_from_message(scene, message), scene.start_state())


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda m: m.bodies.append(m.bodies[0]), "2 bodies of the world state have the same name"),
        (lambda m: m.robots.append(m.robots[0]), "2 robots of the world state have the same name"),
        (lambda m: setattr(m.bodies[0], "name", ""), "bodies with an empty name"),
        (lambda m: setattr(m.header, "frame_id", "map"), "frame 'map'"),
        (lambda m: setattr(m.robots[0], "gripper_opening", float("nan")), "gripper of 'panda_1' holds nan"),
    ],
)
def test_wrong_states_are_named(scene, spoil, says):
    message = convert.state_to_message(scene, scene.start_state())
    message.bodies, message.robots = list(message.bodies), list(message.robots)
    spoil(message)
    with pytest.raises(ConversionError, match=says):
        convert.state_from_message(scene, message)


def test_body(scene):
    body = scene.bodies["tunnel_a"]
    assert equal(convert.body_from_message(body_to_message(body)), body, 1e-6)  # colours are float32


@pytest.mark.parametrize("name", ["", "two words", "1st", "a/b", "bar\n"])
def test_a_body_whose_name_cannot_be_part_of_a_topic_is_refused(scene, name):
    message = body_to_message(scene.bodies["bar"])
    message.name = name
    with pytest.raises(HmapError, match="name of a body") as caught:
        convert.body_from_message(message)
    assert caught.value.code is Code.INVALID_SCENE


def test_a_scene_without_text_says_where_to_get_one():
    with pytest.raises(HmapError, match="get_scene") as caught:
        convert.scene_from_message(Scene())
    assert caught.value.code is Code.INVALID_SCENE


def test_path(scene):
    poses = np.array([transforms.pose((x, 0.0, 0.1)) for x in np.linspace(0.0, 1.0, 6)])
    path = ObjectPath(poses, np.array([2, 5]), np.linspace(0.01, 0.02, 6), "planar")
    response = PlanWaypoints.Response()
    phases.path_to_response(path, "bar", response)
    assert equal(phases.path_from_response(response), path)
    assert len(response.waypoints.waypoints) == 3  # the start, too


def test_contact(scene, contact):
    assert equal(phases.contact_from_message(scene, phases.contact_to_message(contact, "bar")), contact)


def test_contact_without_its_configurations_is_refused(scene, contact):
    message = phases.contact_to_message(contact, "bar")
    message.keyframes = message.keyframes[:7]
    with pytest.raises(ConversionError, match="reach"):
        phases.contact_from_message(scene, message)


def test_motion(scene, trajectory):
    motion, response = SubTrajectory(trajectory, segments()), SolveSegment.Response()
    phases.motion_to_response(scene, motion, response)
    assert equal(phases.motion_from_response(scene, response), motion)


def test_plan(scene, trajectory):
    plan = Plan(scene, trajectory, segments(), scene.goal.pose[None], {"planning_time_s": 0.5})
    back = convert.plan_from_message(convert.plan_to_message(plan))
    assert plan_file.to_dict(back) == plan_file.to_dict(plan)


def test_names_are_looked_up(scene):
    assert convert.known_robots(scene, []) == ["panda_1", "panda_2"]
    for look_up, name in ((convert.known_object, "nix"), (convert.known_object, "table")):
        with pytest.raises(HmapError) as caught:
            look_up(scene, name)
        assert caught.value.code is Code.UNKNOWN_OBJECT and "bar" in caught.value.reason


def test_cloud_without_points_is_none():
    message = SimpleNamespace(cloud=SimpleNamespace(fields=[]))
    assert convert.cloud_from_message(message) is None


@pytest.mark.parametrize("request_type", [PlanWaypoints, ProposeContacts, CheckContacts, SolveSegment])
def test_a_request_has_joints_and_fingers_within_their_limits_or_is_refused(scene, request_type):
    state, told = scene.start_state(), []
    limits = scene.robots["panda_1"].model.position_limits
    state.q["panda_1"][5], state.gripper["panda_2"] = limits[1, 5] + 0.004, -0.0006
    request = request_type.Request(scene=convert.scene_to_message(scene), world=convert.state_to_message(scene, state))
    _, read = scene_and_state(request, told.append)
    assert read.q["panda_1"][5] == limits[1, 5] and read.gripper["panda_2"] == 0.0
    assert len(told) == 2 and "panda_joint6" in told[0] and "opening" in told[1]
    state.q["panda_1"][5] += 0.01
    request.world = convert.state_to_message(scene, state)
    with pytest.raises(InputError, match="panda_joint6 at 3.7665; allowed: -0.0175 to 3.7525"):
        scene_and_state(request, told.append)


def test_where_everything_is_arrives_as_the_whole_state_does(scene):
    state = scene.start_state()
    whole, placed = (make(scene, state) for make in (convert.state_to_message, convert.placement_to_message))
    assert equal(convert.state_from_message(scene, placed), convert.state_from_message(scene, whole))
    assert not any(body.shapes for body in placed.bodies)


def test_a_pose_that_is_none_is_not_sent(scene):
    state = scene.start_state()
    state.poses["bar"] = np.full(7, np.nan)
    with pytest.raises(ConversionError, match="bar"):
        convert.placement_to_message(scene, state)
