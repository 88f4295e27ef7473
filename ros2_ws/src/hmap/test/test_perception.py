"""Drivers of cameras offer their pictures in several ways; perception hears them all."""

import os
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from hmap.node import LATCHED
from hmap.nodes.perception import CAMERA_TOPICS, Perception
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene

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
