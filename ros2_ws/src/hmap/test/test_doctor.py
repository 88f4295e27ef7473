"""What is wrong with a graph is named, with a remedy, and what is right is not."""

import numpy as np
import pytest

from hmap.doctor.findings import (
    FAIL,
    WARN,
    Endpoint,
    Topic,
    action_findings,
    joint_findings,
    message_findings,
    pose_findings,
    state_finding,
    topic_findings,
)
from hmap_core import transforms

KIND = "sensor_msgs/msg/JointState"
DRIVER, PERCEPTION = Endpoint("/driver", True, False), Endpoint("/perception", True, False)
NAN = float("nan")


def topic(**fields) -> Topic:
    given = {"types": (KIND,), "publishers": (DRIVER,), "subscribers": (PERCEPTION,), "messages": 10, "arrived": 100.0}
    return Topic("/joint_states", **(given | {"stamps": (99.0, 99.98)} | fields))


def text_of(findings) -> str:
    (finding,) = findings
    return f"{finding.level} {finding.text}"


def test_a_topic_that_is_as_it_should_be_is_not_named():
    assert topic_findings(topic(), KIND, "start it") == []
    assert message_findings(topic(), 100.0, 1.0, 2.0) == []
    assert topic_findings(topic(publishers=(Endpoint("/a", True, True),)), KIND, "start it") == []


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"publishers": ()}, "FAIL nobody publishes it: start it"),
        ({"types": ("std_msgs/msg/String",)}, "FAIL has the type std_msgs/msg/String, not sensor_msgs/msg/JointState"),
        (
            {"publishers": (Endpoint("/driver", False, False),)},
            "FAIL quality of service: /perception asks for reliable",
        ),
        ({"subscribers": (Endpoint("/perception", True, True),)}, "asks for the last message, which /driver does not"),
    ],
)
def test_topics_that_are_missing_or_of_another_kind_are_named(fields, says):
    assert says in text_of(topic_findings(topic(**fields), KIND, "start it"))


@pytest.mark.parametrize("second", [Endpoint("/perception", False, False)])
def test_a_second_subscription_that_accepts_best_effort_is_enough(second):
    seen = topic(publishers=(Endpoint("/driver", False, False),), subscribers=(PERCEPTION, second))
    assert topic_findings(seen, KIND, "start it") == []


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"messages": 0}, "FAIL no message came within 2 s"),
        ({"stamps": (90.0, 95.0)}, "stale: the newest stamp is 5.00 s old"),
        ({"stamps": (0.0, 0.0)}, "its stamps are 0"),
        ({"stamps": (103.0, 104.0)}, "its stamps are 4.00 s ahead of the clock"),
    ],
)
def test_messages_that_are_stale_or_ahead_are_named(fields, says):
    assert says in text_of(message_findings(topic(**fields), 100.0, 1.0, 2.0))


def test_what_is_optional_is_a_warning():
    (finding,) = topic_findings(topic(publishers=()), KIND, "start it", required=False)
    assert finding.level == WARN


@pytest.mark.parametrize(
    ("seen", "says"),
    [
        ({"a": (0.0, 0.0)}, "FAIL lacks b of 'arm'; it has a: set names.arm_joint"),
        ({"a": (0.0, 0.0), "b": (NAN, 0.0)}, "FAIL positions of b are not finite"),
        ({"a": (0.0, 0.3), "b": (0.0, 0.0)}, "WARN 'arm' moves (a)"),
    ],
)
def test_joints_that_are_missing_or_move_are_named(seen, says):
    assert says in text_of(joint_findings(topic(), seen, {"arm": ["a", "b"]}))


def turned(yaw: float) -> np.ndarray:
    return transforms.pose((0.5, 0.0, 0.1), (0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)))


@pytest.mark.parametrize(
    ("pose", "frames", "says"),
    [
        (np.r_[turned(0.3)[:3], np.roll(turned(0.3)[3:], 1)], {"world"}, "does its driver send w first?"),
        (np.r_[turned(0.3)[:3], 1.1 * turned(0.3)[3:]], {"world"}, "has the norm 1.1000"),
        (np.r_[NAN, turned(0.3)[1:]], {"world"}, "is not finite"),
        (turned(0.3), {"odom"}, "is in frame 'odom', which neither pose_frames nor tf connects"),
    ],
)
def test_poses_that_cannot_be_right_are_named(pose, frames, says):
    found = text_of(pose_findings(topic(frames=frames), "box", pose, ["world"], False, True))
    assert found.startswith(FAIL) and says in found


def test_poses_that_can_be_right_are_not_named():
    tilted = transforms.pose((0, 0, 0), (np.sin(0.5), 0.0, 0.0, np.cos(0.5)))
    for pose, stands in ((turned(0.0), True), (turned(3.0), True), (tilted, False)):
        assert pose_findings(topic(frames={"/world"}), "box", pose, ["world"], False, stands) == []
    assert pose_findings(topic(frames={"mocap"}), "box", turned(0.0), ["world"], True, True) == []


def test_actions_are_named_that_nobody_or_several_offer():
    kind = "control_msgs/action/GripperCommand"
    assert action_findings("arm", kind, [kind], 1, "start it") == []
    assert "no controller offers this action: start it" in text_of(action_findings("arm", kind, [], 0, "start it"))
    assert "2 nodes offer" in text_of(action_findings("arm", kind, [kind], 2, "start it"))
    assert "has the type a/action/B, not" in text_of(action_findings("arm", kind, ["a/action/B"], 1, "start it"))


def test_a_node_that_is_not_active_is_named_with_the_transition():
    assert all(state_finding("/cell/supervisor", state).level == "OK" for state in ("active", ""))
    for state, says in (
        ("inactive", "ros2 lifecycle set /cell/supervisor activate"),
        ("unconfigured", "ros2 lifecycle set /cell/supervisor configure"),
        ("finalized", "is finalized: start it anew"),
    ):
        finding = state_finding("/cell/supervisor", state)
        assert (finding.level, finding.what) == (FAIL, "supervisor") and says in finding.text
