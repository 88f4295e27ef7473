"""What other programs see: transforms, robot descriptions, markers, and plans as trajectories and paths."""

from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker

from hmap.perception.standard_topics import StandardTopics, body_markers, urdf_text
from hmap.supervision.plan_topics import MOST_POINTS, path_of, trajectory_of
from hmap_core.kinematics.arm import load_arm
from hmap_core.scenes import load_scene
from hmap_core.transforms import IDENTITY, inverse, multiply
from hmap_core.types import Body, BodyKind, Plan, Shape, ShapeKind, Trajectory
from hmap_msgs_py.clouds import cloud_from_message


class Published:
    """A node that keeps what is published."""

    def __init__(self):
        self.messages = {}

    def create_publisher(self, kind, topic, qos):
        return SimpleNamespace(publish=lambda message: self.messages.setdefault(topic, []).append(message))

    def destroy_publisher(self, publisher):
        pass


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


@pytest.fixture
def published(scene):
    node = Published()
    topics = StandardTopics(node)
    topics.load(scene, Time())
    topics.show(scene, scene.start_state(), Time(sec=1))
    return node.messages, topics


def pose_in(messages, frame: str) -> np.ndarray:
    """The pose (7,) of a frame in the world, from tf and tf_static."""
    edges = {t.child_frame_id: t for topic in ("tf_static", "tf") for m in messages[topic] for t in m.transforms}
    T = IDENTITY
    while frame != "world":
        edge = edges[frame]
        p, q = edge.transform.translation, edge.transform.rotation
        T = multiply(np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]), T)
        frame = edge.header.frame_id
    return T


def test_transforms_lead_from_the_world_to_hands_bodies_and_cameras(scene, published):
    messages, _ = published
    for name, robot in scene.robots.items():
        hand = multiply(robot.base_pose, load_arm(robot.model).end_effector(robot.q))
        link = pose_in(messages, f"{name}/{robot.model.end_effector_link}")
        np.testing.assert_allclose(multiply(link, robot.model.T_link_ee)[:3], hand[:3], atol=1e-6)
    for name, body in scene.bodies.items():
        np.testing.assert_allclose(multiply(inverse(pose_in(messages, name)), body.pose)[:3], 0.0, atol=1e-9)
    for name, camera in scene.cameras.items():
        np.testing.assert_allclose(pose_in(messages, f"{name}_color_optical_frame")[:3], camera.pose[:3], atol=1e-9)


def test_what_rests_is_not_published_again_at_once(scene, published):
    messages, topics = published
    state = scene.start_state()
    topics.show(scene, state, Time(sec=2))
    assert len(messages["tf"]) == 1
    state.q["panda_1"] = state.q["panda_1"] + 0.01
    topics.show(scene, state, Time(sec=3))
    assert len(messages["tf"]) == 2


def test_meshes_of_a_robot_description_are_found_by_every_reader(scene, published):
    messages, _ = published
    for name, robot in scene.robots.items():
        (message,) = messages[f"{name}/robot_description"]
        assert message.data == urdf_text(name, robot.model)
        urdf = ElementTree.fromstring(message.data)
        assert urdf.get("name") == name
        names = [mesh.get("filename") for mesh in urdf.iter("mesh")]
        assert len(names) > 10
        for address in names:
            parts = urlsplit(address)
            assert parts.scheme == "file" and Path(unquote(parts.path)).is_file()


def test_bodies_are_markers_in_their_own_frames():
    shapes = tuple(
        Shape(kind, size)
        for kind, size in (
            (ShapeKind.BOX, (0.1, 0.2, 0.3)),
            (ShapeKind.SPHERE, (0.1,)),
            (ShapeKind.CYLINDER, (0.1, 0.4)),
            (ShapeKind.CAPSULE, (0.1, 0.4)),
        )
    )
    clear, *markers = body_markers([Body("thing", BodyKind.MOVABLE, shapes, IDENTITY)], Time()).markers
    assert clear.action == Marker.DELETEALL
    kinds = [Marker.CUBE, Marker.SPHERE, Marker.CYLINDER, Marker.CYLINDER, Marker.SPHERE, Marker.SPHERE]
    assert [marker.type for marker in markers] == kinds
    assert {marker.header.frame_id for marker in markers} == {"thing"}
    assert markers[2].scale.x == pytest.approx(0.2) and markers[2].scale.z == pytest.approx(0.4)
    assert len({marker.id for marker in markers}) == len(markers)


def test_clouds_of_all_objects_are_one_cloud_in_the_world(published):
    messages, topics = published
    T = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    topics.show_points({"a": (T, np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0]] * 2))}, Time())
    points, normals = cloud_from_message(messages["points"][0])
    np.testing.assert_allclose(points, [[1.0, 0.0, 0.0]] * 2)
    assert messages["points"][0].header.frame_id == "world" and len(normals) == 2


def test_a_plan_is_a_trajectory_and_a_path(scene):
    count = 5 * MOST_POINTS
    time = np.linspace(0.0, 10.0, count)
    joints = {name: np.tile(robot.q, (count, 1)) for name, robot in scene.robots.items()}
    gripper = {name: np.zeros(count) for name in scene.robots}
    objects = {scene.goal.object: np.tile(scene.goal.pose, (count, 1))}
    plan = Plan(scene, Trajectory(time, joints, gripper, objects), (), np.zeros((0, 7)), {})
    naming = SimpleNamespace(arm_joints=lambda robot, model: [f"{robot}_{joint}" for joint in model.joint_names])
    message = trajectory_of(plan, naming, Time(), "world")
    assert len(message.points) == MOST_POINTS and len(message.joint_names) == 14
    last = message.points[-1].time_from_start
    assert (last.sec, last.nanosec) == (10, 0) and len(message.points[0].positions) == 14
    assert len(path_of(plan, Time(), "world").poses) == MOST_POINTS
