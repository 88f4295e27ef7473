"""Drivers of cameras offer their pictures in several ways; perception hears them all."""

import os
import time

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

from hmap.node import LATCHED
from hmap.nodes.perception import CAMERA_TOPICS, SEGMENTATION_PERIOD, Perception
from hmap.perception.pictures import WITHOUT_MASK, Picture, PictureParts
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene
from hmap_core.simulation.camera import intrinsics
from hmap_core.simulation.world import SimulatedWorld
from hmap_msgs.msg import InstanceNames
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.images import image_to_message
from hmap_msgs_py.poses import pose_to_message
from hmap_msgs_py.times import time_to_message

FIRST_DOMAIN, DOMAINS = 120, 100  # ROS_DOMAIN_ID; each process of tests takes its own
PATIENCE = 30.0  # s to find each other on a busy machine
TASK = "tunnel"
LIVE = QoSProfile(depth=1)  # reliable, keeps nothing
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)


@pytest.fixture
def ros():
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(args=["--ros-args", "-p", f"task:={TASK}"], domain_id=FIRST_DOMAIN + os.getpid() % DOMAINS)
    yield
    rclpy.shutdown()


@pytest.mark.parametrize("qos", [LATCHED, LIVE, SENSOR], ids=["latched", "live", "best effort"])
def test_every_kind_of_camera_is_heard(ros, qos):
    perception, driver = Perception(), rclpy.create_node("driver")
    camera = next(iter(load_scene(TASK, 0).cameras))
    publisher = driver.create_publisher(Image, f"camera/{camera}/{CAMERA_TOPICS['mask'][0]}", qos)
    executor = SingleThreadedExecutor()
    executor.add_node(perception)
    until = time.monotonic() + PATIENCE
    while not publisher.get_subscription_count() and time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
    heard = publisher.get_subscription_count()
    executor.shutdown()
    perception.close()
    perception.destroy_node()
    driver.destroy_node()
    assert heard == 1


def test_without_a_clock_no_measurement_counts_as_fresh(ros):
    perception = Perception()
    perception._check_age(time.time())
    perception.set_parameters([Parameter("use_sim_time", value=True)])
    with pytest.raises(InputError, match="/clock"):
        perception._check_age(time.time())
    perception.close()
    perception.destroy_node()


@pytest.fixture
def perception(ros):
    perception = Perception()
    perception.warned = []
    perception.problems._warn = perception.warned.append
    yield perception
    perception.close()
    perception.destroy_node()


def joints_of(perception) -> list[str]:
    return list(perception._watched.fusion._joints)


def joint_state(names, stamp: float, velocity: float = 0.0) -> JointState:
    message = JointState(name=names, position=[0.01] * len(names), velocity=[velocity, *[0.0] * (len(names) - 1)])
    message.header.stamp = time_to_message(stamp)
    return message


def pose_of(stamp: float, frame: str = "world", w: float = 1.0) -> PoseStamped:
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = time_to_message(stamp), frame
    message.pose.orientation.w = w
    return message


def test_nan_in_one_velocity_blocks_nothing_and_is_named_once(perception):
    take = perception.guarded(perception._take_joints, "joint_states")
    now = time.time()
    for _ in range(20):
        take(joint_state(joints_of(perception), now, float("nan")))
    perception._take_pose(perception._watched.fusion, "bar", pose_of(now))
    perception._publish_state()
    assert perception._status[1] == "measuring"
    assert len(perception.warned) == 1 and "velocity of joint" in perception.warned[0]


def test_each_cause_is_named_once_and_again_when_it_comes_back(perception):
    take = perception.guarded(
        lambda message: perception._take_pose(perception._watched.fusion, "bar", message), "vicon/bar/bar"
    )
    now = time.time()
    for i in range(20):
        take(pose_of(now + 3600.0 + 0.1 * i))
        take(pose_of(now + 0.001 * i, "map"))
    assert len(perception.warned) == 2 + 8  # each comes and goes 20 times: the 1st, 2nd, 4th, 8th and 16th are named
    perception.warned.clear()
    for i in range(20):
        take(pose_of(now + 0.001 * i, w=0.0))
    assert len(perception.warned) == 1 and "norm 0" in perception.warned[0]
    take(pose_of(now))
    take(pose_of(now, w=0.0))
    assert len(perception.warned) == 2


def test_pose_of_an_hour_ahead_does_not_count(perception):
    now = time.time()
    perception._take_joints(joint_state(joints_of(perception), now))
    with pytest.raises(ConversionError, match="'bar' is stamped 3[56][0-9]{2}.* s ahead"):
        perception._take_pose(perception._watched.fusion, "bar", pose_of(now + 3600.0))
    perception._publish_state()
    assert perception._status[1] == "not measured yet: bar"
    with pytest.raises(InputError, match="body 'bar', is stamped 3[56][0-9]{2}.* s ahead"):
        perception._check_age(now + 3600.0, "body 'bar'")


def test_driver_that_sets_no_stamps_is_told_so(perception):
    perception._take_joints(joint_state(joints_of(perception), 0.0))
    perception._take_pose(perception._watched.fusion, "bar", pose_of(time.time()))
    perception._publish_state()
    assert "does its driver set stamps?" in perception._status[1] and "of joint" in perception._status[1]


@pytest.mark.parametrize("frame", ["map", "", "odom"])
def test_unknown_frames_are_refused(perception, frame):
    with pytest.raises(ConversionError, match=f"frame {frame!r}; allowed: 'vicon', 'world'"):
        perception._take_pose(perception._watched.fusion, "bar", pose_of(time.time(), frame))


def test_problems_of_a_camera_are_named_once_whichever_part_comes_last(perception):
    camera = next(iter(perception._watched.fusion.scene.cameras.values()))
    parts = PictureParts(camera, perception._sensor_clock)
    now = int(time.time())
    for order in range(4):
        stamp = Time(sec=now - 4 + order)
        header = Header(stamp=stamp, frame_id="camera")
        image = image_to_message(np.zeros((3, 4), np.uint16), "16UC1", "camera", stamp)
        names = InstanceNames(header=header, numbers=[1, 2], names=["bar", "bar"])
        info = CameraInfo(header=header, k=[5.0, 0.0, 2.0, 0.0, 5.0, 1.5, 0.0, 0.0, 1.0])
        given = [("depth", image), ("info", info), ("mask", image), ("names", names)]
        for part, message in (*given[order:], *given[:order]):
            perception._take_picture(perception._watched, parts, part, message)
    assert len(perception.warned) == 1 and "'bar' has several numbers" in perception.warned[0]


def test_problems_of_now_are_on_the_diagnostics(perception):
    sent = []
    perception._diagnostics = type("Publisher", (), {"publish": staticmethod(sent.append)})
    perception._take_joints(joint_state(joints_of(perception), time.time(), float("nan")))
    perception._publish_diagnostics()
    (status,) = sent[0].status
    assert any(value.key == "problems" and "velocity" in value.value for value in status.values)


@pytest.fixture
def unmasked(perception):
    """Gives a camera's depth and camera info to the node; returns the clouds that it publishes."""
    scene = perception._watched.fusion.scene
    camera = next(iter(scene.cameras.values()))
    image = SimulatedWorld(scene).render(camera)
    depth = np.nan_to_num(1e3 * image.depth).astype(np.uint16)
    published = []
    perception._clouds = type("Publisher", (), {"publish": staticmethod(published.append)})
    parts = PictureParts(camera, perception._sensor_clock)
    without_mask = PictureParts(camera, perception._sensor_clock, WITHOUT_MASK)

    def give(stamp: float):
        perception._take_joints(joint_state(joints_of(perception), stamp))
        for name, body in scene.bodies.items():
            if name in perception._watched.fusion.tracked:
                message = pose_of(stamp)
                message.pose = pose_to_message(body.pose)
                perception._take_pose(perception._watched.fusion, name, message)
        info = CameraInfo(header=Header(stamp=time_to_message(stamp)), k=intrinsics(camera).ravel().tolist())
        picture = image_to_message(depth, "16UC1", "camera", time_to_message(stamp))
        for part, message in (("depth", picture), ("info", info)):
            perception._take_part(perception._watched, parts, without_mask, part, message)
        return published

    return give


def test_a_camera_without_masks_is_segmented_by_geometry(perception, unmasked):
    now = time.time() - 1.0
    (message,) = unmasked(now)
    assert [cloud.object for cloud in message.clouds] == ["bar"] and message.clouds[0].cloud.width > 100
    assert len(unmasked(now + 0.1)) == 1  # not every picture of 30 a second
    assert len(unmasked(now + SEGMENTATION_PERIOD)) == 2


def test_masks_are_waited_for_where_a_node_publishes_them(perception, unmasked):
    camera = next(iter(perception._watched.fusion.scene.cameras))
    driver = perception.create_publisher(Image, f"camera/{camera}/{CAMERA_TOPICS['mask'][0]}", LIVE)
    assert not unmasked(time.time())
    perception.destroy_publisher(driver)


def test_an_unknown_segmentation_is_refused(ros):
    rclpy.shutdown()
    rclpy.init(args=["--ros-args", "-p", "segmentation:=colour"], domain_id=FIRST_DOMAIN + os.getpid() % DOMAINS)
    with pytest.raises(InputError, match="'segmentation' is 'colour'; allowed: auto, mask, geometry"):
        Perception()


def test_a_picture_that_comes_before_the_poses_is_used_when_they_are_there(perception):
    scene, stamp = perception._watched.fusion.scene, time.time()
    camera = next(iter(scene.cameras.values()))
    published = []
    perception._clouds = type("Publisher", (), {"publish": staticmethod(published.append)})
    image = SimulatedWorld(scene).render(camera)
    names = {name: number for number, name in image.names.items()}
    picture = Picture(camera, stamp, image.depth, image.mask, names, intrinsics(camera))
    perception._update_clouds(perception._watched.fusion, picture)
    assert not published[-1].clouds
    perception._take_joints(joint_state(joints_of(perception), stamp))
    message = pose_of(stamp)
    message.pose = pose_to_message(scene.bodies["bar"].pose)
    perception._take_pose(perception._watched.fusion, "bar", message)
    perception._publish_state()
    assert [cloud.object for cloud in published[-1].clouds] == ["bar"] and not perception._unplaced
