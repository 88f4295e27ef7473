"""Round trips of every conversion, and what bad values raise."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2, PointField

from hmap_msgs.msg import ContactFeasibility, ErrorCode, PlanTrajectory, Shape
from hmap_msgs_py import bodies, checks, clouds, contacts, errors, images, plans, poses, times, world

NAN = float("nan")
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
TURNED = np.array([0.1, -0.2, 0.3, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])


def over_the_wire(message):
    """The message after serialisation, as a subscriber gets it."""
    return deserialize_message(serialize_message(message), type(message))


def equal(a, b) -> bool:
    """Deep equality of plain data with arrays in it."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)) and not isinstance(b, np.ndarray):
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return a == b


# --- poses ---


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
)
def test_pose_round_trip(position, quaternion):
    pose = np.concatenate([position, np.array(quaternion) / np.linalg.norm(quaternion)])
    assert np.array_equal(poses.pose_from_message(poses.pose_to_message(pose)), pose)


@pytest.mark.parametrize(
    ("pose", "says"),
    [
        ([0, 0, NAN, 0, 0, 0, 1], "nan"),
        ([0, 0, 0, 0, 0, 0, math.inf], "inf"),
        ([0, 0, 0, 0, 0, 0, 2], "norm 2"),
        ([0, 0, 0, 0, 0, 0, 0], "norm 0"),
        ([0, 0, 0, 1], "size 1 x 4"),
        (["a", 0, 0, 0, 0, 0, 1], "must hold numbers"),
    ],
)
def test_bad_pose_is_named(pose, says):
    with pytest.raises(checks.PoseError, match=says) as caught:
        poses.pose_to_message(pose, "pose of 'bar'")
    assert "pose of 'bar'" in str(caught.value)


@pytest.mark.parametrize(
    ("index", "value", "says"), [(0, NAN, "nan"), (2, math.inf, "inf"), (5, NAN, "nan"), (6, 2.0, "norm 2")]
)
def test_bad_pose_among_others_is_named(index, value, says):
    values = np.tile(IDENTITY, (3, 1)).astype(float)
    messages = poses.poses_to_messages(values)
    assert np.array_equal(poses.poses_from_messages(messages), values)
    values[1, index] = value
    for convert in (lambda: poses.pose_to_message(values[1]), lambda: poses.poses_to_messages(values)):
        with pytest.raises(checks.PoseError, match=says):
            convert()
    setattr(messages[1].position if index < 3 else messages[1].orientation, "xyzxyzw"[index], value)
    with pytest.raises(checks.PoseError, match=rf"poses\[1\].*{says}"):
        poses.poses_from_messages(messages)


def test_bad_pose_message_is_named():
    message = poses.pose_to_message(IDENTITY)
    message.orientation.w = 0.5
    with pytest.raises(checks.PoseError, match="norm 0.5"):
        poses.pose_from_message(message)


def test_no_poses_are_no_messages():
    assert poses.poses_to_messages(np.empty((0, 7))) == []
    assert poses.poses_from_messages([]).shape == (0, 7)


# --- clouds and images ---


def random_cloud(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(n, 3))
    return rng.normal(size=(n, 3)).astype(np.float32), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("n", [0, 1, 1000])
def test_cloud_round_trip(n):
    points, normals = random_cloud(n)
    message = over_the_wire(clouds.object_cloud_to_message("bar", TURNED, points, normals))
    back = clouds.object_cloud_from_message(message)
    assert back["object"] == message.cloud.header.frame_id == "bar"
    assert np.array_equal(back["pose"], TURNED)
    assert np.array_equal(back["points"], points)
    assert np.array_equal(back["normals"], normals.astype(np.float32))


def test_cloud_without_normals():
    points, _ = random_cloud(5)
    back, normals = clouds.cloud_from_message(clouds.cloud_to_message(points, frame_id="camera"))
    assert normals is None and np.array_equal(back, points)


def test_cloud_of_a_depth_camera_has_padding_rows_and_missing_points():
    """Two rows of two points of 20 bytes, 4 more at the end of each row, big endian, x first but y and z swapped."""
    values = np.array([[1, 2, 3], [NAN, NAN, NAN], [4, 5, 6], [7, 8, 9]], ">f4")
    raw = np.zeros((2, 44), np.uint8)
    for i, (x, y, z) in enumerate(values):
        start = (i % 2) * 20
        raw[i // 2, start : start + 12] = np.array([x, z, y], ">f4").view(np.uint8)
    offsets = {"x": 0, "z": 4, "y": 8}
    fields = [PointField(name=n, offset=o, datatype=PointField.FLOAT32, count=1) for n, o in offsets.items()]
    message = PointCloud2(
        height=2, width=2, fields=fields, is_bigendian=True, point_step=20, row_step=44, data=clouds.byte_array(raw)
    )
    points, _ = clouds.cloud_from_message(message)
    assert points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_bad_clouds_are_named():
    points, normals = random_cloud(4)
    with pytest.raises(checks.ConversionError, match="3 values for 4 points"):
        clouds.cloud_to_message(points, normals[:3])
    with pytest.raises(checks.ConversionError, match="norm"):
        clouds.cloud_to_message(points, 2 * normals)
    with pytest.raises(checks.ConversionError, match="size 4 x 2"):
        clouds.cloud_to_message(points[:, :2])
    with pytest.raises(checks.ConversionError, match="nan"):
        clouds.cloud_to_message(np.full((1, 3), NAN))
    message = clouds.cloud_to_message(points)
    message.data = message.data[:-1]
    with pytest.raises(checks.ConversionError, match="47 bytes"):
        clouds.cloud_from_message(message)
    message.fields = message.fields[:2]
    with pytest.raises(checks.ConversionError, match="no float field 'z'"):
        clouds.cloud_from_message(message)


@pytest.mark.parametrize("encoding", sorted(images.ENCODINGS))
def test_image_round_trip(encoding):
    kind, channels = images.ENCODINGS[encoding]
    pixels = np.arange(6 * channels).astype(kind).reshape((2, 3) + ((channels,) if channels > 1 else ()))
    back = images.image_from_message(over_the_wire(images.image_to_message(pixels, encoding, "camera")))
    assert back.dtype == pixels.dtype and np.array_equal(back, pixels)


def test_depth_is_in_metres_and_missing_is_nan():
    millimetres = np.array([[0, 1500]], np.uint16)
    depth = images.depth_from_message(images.image_to_message(millimetres, "16UC1"))
    assert math.isnan(depth[0, 0]) and depth[0, 1] == np.float32(1.5)
    metres = np.array([[NAN, 1.5]], np.float32)
    assert np.array_equal(images.depth_from_message(images.image_to_message(metres, "32FC1")), metres, equal_nan=True)


def test_bad_images_are_named():
    with pytest.raises(checks.ConversionError, match="float64"):
        images.image_to_message(np.zeros((2, 2)), "32FC1")
    with pytest.raises(checks.ConversionError, match="unknown image encoding 'jpeg'"):
        images.image_from_message(Image(encoding="jpeg"))
    with pytest.raises(checks.ConversionError, match="3 bytes"):
        images.image_from_message(Image(encoding="mono8", width=2, height=2, step=2, data=[0, 0, 0]))
    with pytest.raises(checks.ConversionError, match="rgb8"):
        images.depth_from_message(images.image_to_message(np.zeros((1, 1, 3), np.uint8), "rgb8"))


# --- world ---

BAR = {
    "name": "bar",
    "kind": "movable",
    "shapes": (
        {"kind": "box", "size": (1.0, 0.08, 0.08), "pose": IDENTITY, "mesh": None},
        {"kind": "mesh", "size": (1.0, 1.0, 1.0), "pose": TURNED, "mesh": "hmap_scenes://objects/handle.obj"},
    ),
    "pose": TURNED,
    "mass": 0.4,
    "friction": 0.6,
    "graspable": (np.array([[-0.5, -0.1, -0.1], [0.5, 0.1, 0.1]]),),
    "color": (0.5, 0.25, 1.0, 1.0),
}
WALL = {
    "name": "wall",
    "kind": "fixed",
    "shapes": ({"kind": "sphere", "size": (0.1,), "pose": IDENTITY, "mesh": None},),
    "pose": IDENTITY,
    "mass": 0.0,
    "friction": 0.6,
    "graspable": (),
    "color": None,
}
LEFT = {
    "name": "left",
    "model": "panda",
    "base_pose": TURNED,
    "joint_names": ("joint1", "joint2"),
    "q": np.array([0.5, -1.5]),
    "velocity": None,
    "gripper": 0.04,
}


@pytest.mark.parametrize("body", [BAR, WALL], ids=lambda body: body["name"])
def test_body_round_trip(body):
    assert equal(bodies.body_from_message(over_the_wire(bodies.body_to_message(body))), body)


def test_objects_with_attributes_are_taken_like_dicts():
    assert bodies.body_to_message(SimpleNamespace(**BAR)) == bodies.body_to_message(BAR)


def test_body_at_another_pose():
    assert poses.pose_from_message(bodies.body_to_message(BAR, IDENTITY).pose).tolist() == IDENTITY.tolist()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "liquid"}, "kind of 'bar' is 'liquid'"),
        ({"mass": NAN}, "mass of 'bar'"),
        ({"pose": 2 * IDENTITY}, "quaternion of pose of 'bar'"),
        ({"graspable": (np.zeros((2, 2)),)}, "graspable of 'bar'"),
        ({"shapes": ({"kind": "box", "size": (1.0,), "pose": IDENTITY},)}, "size of box has size 1; it must be 3"),
        ({"shapes": ({"kind": "cone", "size": (1.0,), "pose": IDENTITY},)}, "box, cylinder, sphere, capsule, mesh"),
    ],
)
def test_bad_body_is_named(change, says):
    with pytest.raises(checks.ConversionError, match=says):
        bodies.body_to_message(BAR | change)


def test_world_state_round_trip():
    message = world.world_state_to_message("tunnel", 3, "physical", [LEFT], [BAR, WALL])
    back = world.world_state_from_message(over_the_wire(message))
    assert equal(back["robots"], {"left": LEFT}) and equal(back["bodies"], {"bar": BAR, "wall": WALL})
    assert (back["task"], back["seed"], back["mode"]) == ("tunnel", 3, "physical")
    assert equal(back["q"], {"left": LEFT["q"]}) and equal(back["poses"], {"bar": TURNED, "wall": IDENTITY})


def test_bad_world_states_are_named():
    with pytest.raises(checks.ConversionError, match="position of 'left' has size 1; it must be 2"):
        world.robot_state_to_message(LEFT | {"q": [0.0]})
    message = world.robot_state_to_message(LEFT)
    message.position[1] = NAN
    with pytest.raises(checks.ConversionError, match="position of 'left' holds nan"):
        world.robot_state_from_message(message)
    twice = world.world_state_to_message("tunnel", 0, "kinematic", [], [BAR, BAR])
    with pytest.raises(checks.ConversionError, match="same name"):
        world.world_state_from_message(twice)


def test_scene_round_trip():
    definition = {"task": "tunnel", "seed": 7, "mode": "kinematic", "scene": {"bodies": []}}
    message = over_the_wire(world.scene_to_message(definition))
    assert (message.task, message.seed) == ("tunnel", 7) and world.scene_from_message(message) == definition


@pytest.mark.parametrize("text", ["{", "[]"])
def test_bad_scene_text_is_named(text):
    message = world.scene_to_message({"task": "tunnel", "seed": 0, "mode": "kinematic"})
    message.text = text
    with pytest.raises(checks.ConversionError, match="JSON"):
        world.scene_from_message(message)


# --- contacts ---

CONTACT = {
    "kind": "grasp",
    "T_obj_ee": TURNED,
    "point": np.array([0.1, 0.04, 0.0]),
    "normal": np.array([0.0, 1.0, 0.0]),
    "opening": 0.06,
    "approach": np.array([0.0, 0.0, 1.0]),
    "score": 0.75,
}


def test_contact_round_trip():
    keyframes = np.arange(14.0).reshape(2, 7)
    message = over_the_wire(contacts.contact_to_message(CONTACT, "left", "bar", 1, keyframes, ["right"]))
    assert (message.robot, message.object, message.reach, message.clear) == ("left", "bar", 1, ["right"])
    assert np.array_equal(contacts.keyframes_from_message(message, 7), keyframes)
    assert equal(contacts.contact_from_message(message), CONTACT)


def test_a_press_keeps_its_force():
    press = CONTACT | {"kind": "press", "force": 6.5}
    message = over_the_wire(contacts.contact_to_message(press, "left", "bar"))
    assert equal(contacts.contact_from_message(message), press)
    segment = SEGMENT | {"object": "bar", "kind": "press", "contact_pose": TURNED, "force": 6.5}
    assert equal(plans.segment_from_message(over_the_wire(plans.segment_to_message(segment))), segment)
    with pytest.raises(checks.ConversionError, match="force"):
        plans.segment_to_message(segment | {"force": NAN})


@pytest.mark.parametrize("change", [{"normal": [0, 2, 0]}, {"approach": [0, 0, 0]}, {"kind": "suck"}, {"score": NAN}])
def test_bad_contact_is_refused(change):
    with pytest.raises(checks.ConversionError):
        contacts.contact_to_message(CONTACT | change, "left", "bar")


def test_feasibility_round_trip():
    keyframes = np.arange(14.0).reshape(2, 7)
    message = over_the_wire(contacts.feasibility_to_message(keyframes))
    assert message.reach == 1 and np.array_equal(contacts.keyframes_from_message(message, 7), keyframes)
    refused = contacts.feasibility_to_message(None)
    assert not refused.feasible and refused.error.code == ErrorCode.NO_CONTACT
    assert len(contacts.keyframes_from_message(refused, 7)) == 0
    with pytest.raises(checks.ConversionError, match="rows of 7"):
        contacts.keyframes_from_message(ContactFeasibility(feasible=True, keyframes=[0.0] * 8), 7)


# --- plans ---

SEGMENT = {
    "start": 0.0,
    "end": 0.02,
    "robot": "left",
    "manipulator": "hand",
    "object": None,
    "kind": "transit",
    "contact_pose": None,
}
PLAN = {
    "format": "hmap-plan",
    "version": 1,
    "task": "tunnel",
    "seed": 4,
    "mode": "kinematic",
    "goal": {"object": "bar", "pose": TURNED.tolist()},
    "robots": {"left": {"joint_names": ["joint1", "joint2"]}},
    "scene": {"bodies": [{"name": "bar"}]},
    "trajectory": {
        "time": [0.0, 0.02, 0.04],
        "joints": {"left": [[0.0, 1.0], [0.1, 1.1], [0.2, 1.2]]},
        "gripper": {"left": [0.08, 0.07, 0.06]},
        "objects": {"bar": [IDENTITY.tolist(), IDENTITY.tolist(), TURNED.tolist()]},
    },
    "segments": [
        SEGMENT,
        SEGMENT | {"start": 0.02, "end": 0.04, "object": "bar", "kind": "grasp", "contact_pose": TURNED.tolist()},
    ],
    "waypoints": [IDENTITY.tolist(), TURNED.tolist()],
    "stats": {"planning_time_s": 0.25, "mode_switches": 1, "robots_used": ["left"]},
}


def test_plan_round_trip():
    message = over_the_wire(plans.plan_to_message(PLAN))
    back = plans.plan_from_message(message)
    assert back == PLAN
    assert json.loads(json.dumps(back)) == PLAN


def test_trajectory_columns_follow_the_joint_names():
    message = plans.trajectory_to_message(PLAN["trajectory"], {"left": ["joint1", "joint2"]})
    swapped = plans.trajectory_from_message(message, {"left": ["joint2", "joint1"]})
    assert swapped["joints"]["left"].tolist() == [[1.0, 0.0], [1.1, 0.1], [1.2, 0.2]]
    with pytest.raises(checks.ConversionError, match="they must be joint1, joint9"):
        plans.trajectory_from_message(message, {"left": ["joint1", "joint9"]})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"time": [0.0, 0.02, 0.02]}, "increase"),
        ({"time": [0.0, 0.02]}, "size 3 x 2; it must be 2 x 2"),
        ({"gripper": {"left": [0.08, NAN, 0.06]}}, "gripper of 'left' holds nan"),
        ({"objects": {"bar": [[0.0] * 7] * 3}}, "quaternion of path of 'bar'"),
    ],
)
def test_bad_trajectory_is_named(change, says):
    with pytest.raises(checks.ConversionError, match=says):
        plans.trajectory_to_message(PLAN["trajectory"] | change, {"left": ["joint1", "joint2"]})


def test_bad_trajectory_message_is_named():
    message = plans.trajectory_to_message(PLAN["trajectory"], {"left": ["joint1", "joint2"]})
    message.robots[0].positions = message.robots[0].positions[:-1]
    with pytest.raises(checks.ConversionError, match="5 values; it must have 3 rows of 2"):
        plans.trajectory_from_message(message)


def test_empty_trajectory():
    assert plans.trajectory_from_message(PlanTrajectory())["time"].shape == (0,)


# --- times and joint trajectories ---


@pytest.mark.parametrize("seconds", [0.0, 0.02, 1.999999999, -0.25, 1.7e9])
def test_time_round_trip(seconds):
    assert times.seconds_from_message(times.duration_to_message(seconds)) == pytest.approx(seconds, abs=1e-9)
    assert times.seconds_from_message(times.time_to_message(seconds)) == pytest.approx(seconds, abs=1e-9)


def test_joint_trajectory_round_trip_by_name():
    positions, velocities = np.array([[0.0, 1.0], [0.5, 1.5]]), np.array([[0.1, 0.2], [0.0, 0.0]])
    message = over_the_wire(times.joint_trajectory_to_message(["a", "b"], [0.0, 0.5], positions, velocities))
    time, q, v = times.joint_trajectory_from_message(message, ["b", "a"])
    assert time.tolist() == [0.0, 0.5]
    assert np.array_equal(q, positions[:, ::-1]) and np.array_equal(v, velocities[:, ::-1])
    without = times.joint_trajectory_to_message(["a", "b"], [0.0, 0.5], positions)
    assert times.joint_trajectory_from_message(without, ["a", "b"])[2] is None


def test_efforts_of_a_joint_trajectory_round_trip_by_name():
    positions, efforts = np.array([[0.0, 1.0], [0.5, 1.5]]), np.array([[0.0, 0.0], [3.0, -2.0]])
    message = over_the_wire(times.joint_trajectory_to_message(["a", "b"], [0.0, 0.5], positions, None, efforts))
    assert np.array_equal(times.joint_efforts_from_message(message, ["b", "a"]), efforts[:, ::-1])
    without = times.joint_trajectory_to_message(["a", "b"], [0.0, 0.5], positions)
    assert times.joint_efforts_from_message(without, ["a", "b"]) is None
    message.points[1].effort = [0.0]
    with pytest.raises(checks.ConversionError, match="effort of point 1 has 1 values for 2 joints"):
        times.joint_efforts_from_message(message, ["a", "b"])


def test_bad_joint_trajectories_are_named():
    message = times.joint_trajectory_to_message(["a", "b"], [0.0, 0.5], np.zeros((2, 2)))
    with pytest.raises(checks.ConversionError, match="must be for a, c"):
        times.joint_trajectory_from_message(message, ["a", "c"])
    message.points[1].positions = [0.0]
    with pytest.raises(checks.ConversionError, match="positions of point 1 has 1 values for 2 joints"):
        times.joint_trajectory_from_message(message, ["a", "b"])
    message.points[1].positions = [0.0, NAN]
    with pytest.raises(checks.ConversionError, match="nan"):
        times.joint_trajectory_from_message(message, ["a", "b"])
    message.points[1].positions = [0.0, 0.0]
    message.points[1].time_from_start.nanosec = 0
    with pytest.raises(checks.ConversionError, match="increase"):
        times.joint_trajectory_from_message(message, ["a", "b"])


# --- errors ---


def test_errors_keep_code_stage_and_reason():
    class Planner(Exception):
        code, stage, reason = 300, "contacts", "no contact on 'bar'"

    assert errors.error_to_message(Planner()) == ErrorCode(code=300, stage="contacts", reason="no contact on 'bar'")
    assert errors.error_to_message().code == ErrorCode.SUCCESS
    assert errors.error_to_message(checks.PoseError("p")).code == ErrorCode.INVALID_POSE
    assert errors.error_to_message(checks.ConversionError("c")).code == ErrorCode.INVALID_INPUT
    unknown = errors.error_to_message(KeyError("x"))
    assert unknown.code == ErrorCode.INTERNAL and "KeyError" in unknown.reason


def test_shape_kinds_of_the_message_are_all_known():
    constants = {Shape.BOX, Shape.CYLINDER, Shape.SPHERE, Shape.CAPSULE, Shape.MESH}
    assert set(bodies.SHAPE_KINDS) == constants
