"""Definitions as text agree with the built messages, byte for byte on the wire."""

import json
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message, serialize_message

import hmap_msgs.msg as messages
from hmap_msgs.msg import ErrorCode, ObjectPath, PlannerStatus
from hmap_msgs_py.definitions import definitions, typestore

# lib/python3.x/site-packages/hmap_msgs/msg/__init__.py lies in the same prefix as share
SHARE = Path(messages.__file__).parents[5] / "share" / "hmap_msgs"


def test_every_message_is_there():
    public = {name for name in dir(messages) if not name.startswith("_") and name[0].isupper()}
    assert {name.split("/")[-1] for name in definitions()} == public


@pytest.mark.parametrize("name", sorted(definitions()))
def test_type_hash_equals_the_built_one(name):
    built = json.loads((SHARE / "msg" / f"{name.split('/')[-1]}.json").read_text())
    expected = next(entry["hash_string"] for entry in built["type_hashes"] if entry["type_name"] == name)
    assert typestore().hash_rihs01(name) == expected


def test_bytes_of_ros_are_read_without_ros():
    store = typestore()
    message = PlannerStatus(phase=PlannerStatus.CONTACTS, waypoint=2, waypoint_count=5, attempt=3, text="candidate 3")
    read = store.deserialize_cdr(serialize_message(message), "hmap_msgs/msg/PlannerStatus")
    assert (read.phase, read.waypoint, read.waypoint_count, read.attempt, read.text) == (
        "contacts", 2, 5, 3, "candidate 3",
    )  # fmt: skip
    path = ObjectPath(object="bar", poses=[0.5] * 14)
    assert list(store.deserialize_cdr(serialize_message(path), "hmap_msgs/msg/ObjectPath").poses) == [0.5] * 14


def test_bytes_written_without_ros_are_read_by_ros():
    store = typestore()
    error = store.types["hmap_msgs/msg/ErrorCode"](code=300, stage="contacts", reason="none reaches")
    data = bytes(store.serialize_cdr(error, "hmap_msgs/msg/ErrorCode"))
    assert deserialize_message(data, ErrorCode) == ErrorCode(code=300, stage="contacts", reason="none reaches")
