"""control_msgs and tf2_msgs, wherever they come from, are the standard ones: a real controller answers only to these.

The hashes are those of control_msgs 5.8.0 (Jazzy), computed from its own definitions, and of tf2_msgs in rosbags.
"""

import json
from pathlib import Path

import control_msgs.action
import pytest
import tf2_msgs.msg
from rosbags.typesys import Stores, get_typestore

HASHES = {
    "msg/GripperCommand": "57eb8f326c9889ca8bb34ead82cc94cc09bf6bc5c3b6c09546dca3a00b589890",
    "msg/JointTolerance": "c254f9cece0f3b733017b6990fd46d1326e25242d6b8844398c97d9a88e7d648",
    "msg/JointComponentTolerance": "739ea7566931944d33830fa10f1bf5e7a7fbdc3172bce7a7eaac642bd6e3ffa4",
    "action/FollowJointTrajectory_Goal": "8a9060704b269608f5a340934cc26e66869dd14bdac29e2e7fd9ec8b9882d205",
    "action/FollowJointTrajectory_Result": "8002e99ed2c14c6faa522f2a93c26d744c5982f254f9e98ff9c6f19789bdb220",
    "action/FollowJointTrajectory_Feedback": "3fd0aaecf71725121ae1ff7f01098a5e0da581e672be18a6b2c286cb43d96b49",
    "action/GripperCommand_Goal": "607d9f41eb241e1922e90f02125e87ae6bfb78f7f64a71dc92630263d01f8b6d",
    "action/GripperCommand_Result": "bf512d5aa6a0e4fe4d8be22b2ec4a1973c3d250fa1f65e47450322c25c45c0a0",
    "action/GripperCommand_Feedback": "8f7c520077bab528bb9161ee3b83c81eee1f8aecadb8922ce82c79d667a819c4",
}


def built_hash(module: str, package: str, name: str) -> str:
    """The hash of ``name``, such as msg/JointTolerance, from the built package that ``module`` is a file of."""
    share = Path(module).parents[5] / "share" / package  # beside lib/python3.x/site-packages/<package>/msg/__init__.py
    entries = json.loads((share / f"{name.split('_')[0]}.json").read_text())["type_hashes"]
    return next(entry["hash_string"] for entry in entries if entry["type_name"] == f"{package}/{name}")


@pytest.mark.parametrize("name", HASHES)
def test_control_msgs_are_the_standard(name):
    assert built_hash(control_msgs.action.__file__, "control_msgs", name) == f"RIHS01_{HASHES[name]}"


def test_tf2_msgs_are_the_standard():
    expected = get_typestore(Stores.ROS2_JAZZY).hash_rihs01("tf2_msgs/msg/TFMessage")
    assert built_hash(tf2_msgs.msg.__file__, "tf2_msgs", "msg/TFMessage") == expected
