"""Feedback of controllers and goals for them, in which something is wrong."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance

from hmap.supervision.controllers import Command
from hmap.world.actions import ControllerActions
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene
from hmap_msgs_py.checks import ConversionError

JOINTS = ["a", "b"]
NAN = float("nan")


@pytest.fixture
def command():
    client = SimpleNamespace(send_goal_async=lambda *_: SimpleNamespace(add_done_callback=lambda _: None))
    return Command("arm", client, None, threading.Event(), JOINTS)


def feedback(second: int, desired, error=(), names=JOINTS):
    message = FollowJointTrajectory.Feedback(joint_names=list(names))
    message.header.stamp = Time(sec=second)
    message.desired.positions, message.error.positions = list(desired), list(error)
    return SimpleNamespace(feedback=message)


def test_feedback_is_read_field_by_field(command):
    command._report(feedback(1, [0.1, 0.2], [0.0, -0.01]))
    command._report(feedback(2, [], [0.02, 0.0]))  # not every driver tells where it wants to be
    command._report(feedback(3, [0.3, 0.4], []))
    command._report(feedback(4, [NAN, 0.5], [NAN, 9.0]))
    command._report(feedback(5, [0.5], [9.0]))
    command._report(feedback(6, [0.6, 0.7], [0.0, 0.0], ["a", "a"]))
    assert [entry.stamp for entry in command.feedback] == [1.0, 3.0]
    assert command.feedback[-1].positions.tolist() == [0.3, 0.4]
    assert command.tracking_error == pytest.approx(0.02)


def test_older_feedback_replaces_nothing(command):
    for second in (1, 3, 2):
        command._report(feedback(second, [0.1 * second, 0.0]))
    assert command.feedback[-1].stamp == 3.0
    late = feedback(4, [0.4, 0.0])
    late.feedback.header.stamp.nanosec = 2_000_000_000  # is no stamp
    command._report(late)
    assert command.feedback[-1].stamp == 3.0


@pytest.fixture(scope="module")
def actions():
    robot = load_scene("tunnel", 0).robots["panda_1"]
    names = dict(zip([f"wire_{i}" for i in range(7)], robot.model.joint_names, strict=True))
    return SimpleNamespace(_joints=names, _robot=robot)


def tolerances(actions, *entries):
    given = [JointTolerance(name=name, position=value) for name, value in entries]
    return ControllerActions._per_joint(actions, "path_tolerance", given, 0.1)


def test_tolerances_of_a_goal_are_by_joint(actions):
    found = tolerances(actions, ("wire_1", 0.3), ("wire_2", -1.0))
    assert found.tolist() == [0.1, 0.3, np.inf, 0.1, 0.1, 0.1, 0.1]


@pytest.mark.parametrize(
    ("entries", "says"),
    [
        ([("wire_9", 0.1)], "'wire_9'; the arm has wire_0, "),
        ([("wire_1", 0.1), ("wire_1", 0.2)], "'wire_1' twice"),
        ([("wire_1", NAN)], "path_tolerance of joint 'wire_1' holds nan"),
        ([("", 0.1)], "the joint ''"),
    ],
)
def test_wrong_tolerances_are_refused_and_named(actions, entries, says):
    with pytest.raises((InputError, ConversionError), match=says):
        tolerances(actions, *entries)
