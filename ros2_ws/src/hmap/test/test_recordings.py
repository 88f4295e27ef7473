"""Bags as the page reads them."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from hmap.bags.writer import BagWriter
from hmap.conversions import cloud_to_message, scene_to_message, state_to_message
from hmap.recordings import read_bag
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene
from hmap_core.transforms import pose
from hmap_msgs.msg import ObjectClouds, PlannerStatus
from hmap_msgs_py.definitions import typestore
from hmap_msgs_py.times import time_to_message


def write(path, messages) -> None:
    """A bag with messages: topic, type, time (s), message."""
    writer, connections, types = BagWriter(path), {}, typestore()
    for topic, kind, time, message in messages:
        if topic not in connections:
            connections[topic] = writer.add(topic, kind, types)
        writer.write(connections[topic], round(time * 1e9), serialize_message(message))
    writer.close()


def run(scene):
    """A second of a scene in which the first robot moves."""
    yield "/scene", "hmap_msgs/msg/Scene", 5.0, scene_to_message(scene)
    yield "/planner_status", "hmap_msgs/msg/PlannerStatus", 5.0, PlannerStatus(phase="execution", text="transit")
    cloud = Cloud(np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.ones(1, bool))
    clouds = ObjectClouds(clouds=[cloud_to_message("bar", pose((1.0, 0.0, 0.0)), cloud)])
    yield "/object_clouds", "hmap_msgs/msg/ObjectClouds", 5.0, clouds
    for k in range(11):
        state = scene.start_state()
        state.q["panda_1"] = state.q["panda_1"] + 0.01 * k
        message = state_to_message(scene, state, time_to_message(5.0 + 0.1 * k))
        yield "/world_state", "hmap_msgs/msg/WorldState", 5.0 + 0.1 * k, message


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


def test_a_bag_is_read_as_what_was_measured(scene, tmp_path):
    write(tmp_path / "bag", run(scene))
    for path in (tmp_path, tmp_path / "bag", next((tmp_path / "bag").glob("*.mcap"))):
        recording = read_bag(path)
        assert recording.duration == pytest.approx(1.0)
        assert recording.caption(0.5) == "execution: transit"
        np.testing.assert_allclose(recording.cloud(0.5)["bar"], [[1.1, 0.0, 0.0]], atol=1e-6)
        half = recording.state(0.5).q["panda_1"]
        np.testing.assert_allclose(half, scene.robots["panda_1"].q + 0.05, atol=1e-6)


def test_a_bag_without_what_is_needed_says_so(scene, tmp_path):
    write(tmp_path / "nothing", [])
    write(tmp_path / "still", list(run(scene))[:2])
    (tmp_path / "empty").mkdir()
    for name, reason in (("nothing", "`scene`"), ("still", "`world_state`"), ("empty", "is no bag")):
        with pytest.raises(InputError, match=reason):
            read_bag(tmp_path / name)
