"""Feedback of controllers and goals for them, in which something is wrong."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance

from hmap.supervision import controllers as module
from hmap.supervision.controllers import Command
from hmap.supervision.gripper_position import GripperPosition
from hmap.world.actions import ControllerActions
from hmap_core.exceptions import Code, ExecutionError, InputError
from hmap_core.scenes import load_scene
from hmap_core.scenes.robots import load_robot_model
from hmap_core.types import JointTrajectory
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


# controllers that do not answer or do not move, over a monitor whose states are set by the test

TIMEOUT = 0.3  # s


class Monitor:
    """Stands in for the scene monitor: its state is set by the test, and its clock runs with the test's."""

    def __init__(self, scene):
        self.now, self.fresh = scene.start_state(), True
        self._began = time.monotonic()

    def silent(self) -> bool:
        return self.newest() is None

    def newest(self):
        return (10.0 * (time.monotonic() - self._began), self.now.copy()) if self.fresh else None

    def state(self, patience):
        return self.newest()


class Node:
    """What commands need of a node."""

    group = None

    def __init__(self):
        self.stopping = threading.Event()

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1))


class Handle:
    """A goal that a controller has accepted; it never ends by itself."""

    accepted = True

    def __init__(self):
        self.canceled = False

    def cancel_goal_async(self):
        self.canceled = True

    def get_result_async(self):
        return SimpleNamespace(add_done_callback=lambda _: None)


class Client:
    """An action client whose server does as told."""

    handle = None  # of the goals; None: the server never answers

    def __init__(self, *_, **__):
        pass

    def wait_for_server(self, _):
        return True

    def send_goal_async(self, goal, _):
        self.goals.append(goal)
        handle = self.handle

        def add_done_callback(callback):
            if handle is not None:
                callback(SimpleNamespace(result=lambda: handle))

        return SimpleNamespace(add_done_callback=add_done_callback)


@pytest.fixture
def cell(monkeypatch):
    """Controllers of the tunnel's first robot, the monitor, and the client of each action."""
    scene = load_scene("tunnel", 0)
    monkeypatch.setattr(module, "ActionClient", Client)
    monkeypatch.setattr(module, "START_PATIENCE", 0.1)
    monkeypatch.setattr(Client, "goals", [], raising=False)
    naming = SimpleNamespace(
        arm_joints=lambda robot, model: list(model.joint_names),
        arm_action=lambda robot: f"{robot}/arm",
        gripper_action=lambda robot: f"{robot}/gripper",
    )
    monitor = Monitor(scene)
    robot = scene.robots["panda_1"]
    controllers = module.Controllers(Node(), naming, monitor, TIMEOUT)
    return SimpleNamespace(controllers=controllers, monitor=monitor, robot=robot, client=Client)


def swing(robot, duration: float = 0.5, begin: float = 0.0) -> JointTrajectory:
    q = robot.q + np.array([[begin], [begin + 0.5]]) * np.eye(7)[0]
    return JointTrajectory(robot.model.joint_names, np.array([0.0, duration]), q, np.zeros((2, 7)))


def outcome(cell, command) -> ExecutionError:
    with pytest.raises(ExecutionError) as error:
        cell.controllers.wait([command], 60.0, lambda: False)
    return error.value


def test_in_a_dry_run_nothing_is_sent_to_any_controller(cell):
    cell.controllers.locked = True
    with pytest.raises(ExecutionError, match="nothing is sent to 'panda_1/arm' in a dry run") as error:
        cell.controllers.move(cell.robot, swing(cell.robot))
    assert error.value.code is Code.SERVICE_UNAVAILABLE and not cell.client.goals


def test_a_controller_that_is_not_there_is_named(cell, monkeypatch):
    monkeypatch.setattr(cell.client, "wait_for_server", lambda *_: False)
    with pytest.raises(ExecutionError, match="no controller has offered the action 'panda_1/arm'") as error:
        cell.controllers.move(cell.robot, swing(cell.robot))
    assert error.value.code is Code.SERVICE_UNAVAILABLE and not cell.client.goals


def test_a_controller_that_never_answers_is_named(cell):
    began = time.monotonic()
    error = outcome(cell, cell.controllers.move(cell.robot, swing(cell.robot)))
    assert error.code is Code.CONTROLLER_LOST and "'panda_1/arm' is lost: it has not answered for" in error.reason
    assert time.monotonic() - began < 10.0 and cell.controllers.accepted == 0
    cell.controllers.stop()  # nothing is waited for twice
    assert time.monotonic() - began < 10.0


def test_a_controller_that_accepts_and_does_not_move_is_named_with_the_joint(cell, monkeypatch):
    monkeypatch.setattr(Client, "handle", Handle())
    error = outcome(cell, cell.controllers.move(cell.robot, swing(cell.robot)))
    assert error.code is Code.CONTROLLER_LOST and "it does not move: panda_joint1 has stood at" in error.reason
    assert Client.handle.canceled and cell.controllers.accepted == 1


def test_a_controller_that_moves_and_never_ends_is_named(cell, monkeypatch):
    monkeypatch.setattr(Client, "handle", Handle())
    command = cell.controllers.move(cell.robot, swing(cell.robot))
    cell.monitor.now.q["panda_1"] = swing(cell.robot).positions[-1]
    error = outcome(cell, command)
    assert error.code is Code.CONTROLLER_LOST and "it does not end" in error.reason


def test_an_arm_that_waits_as_planned_is_not_lost(cell, monkeypatch):
    monkeypatch.setattr(Client, "handle", Handle())
    q = cell.robot.q + np.array([[0.0], [0.0], [0.5]]) * np.eye(7)[0]
    times = np.array([0.0, 1e6, 1e6 + 1.0])
    motion = JointTrajectory(cell.robot.model.joint_names, times, q, np.zeros((3, 7)))
    command = cell.controllers.move(cell.robot, motion)
    with pytest.raises(ExecutionError) as error:
        cell.controllers.wait([command], 3.0 * TIMEOUT, lambda: False)
    assert error.value.code is Code.TRACKING_LOST  # the limit of the wait


def test_a_gripper_that_accepts_and_does_not_end_is_named(cell, monkeypatch):
    monkeypatch.setattr(Client, "handle", Handle())
    error = outcome(cell, cell.controllers.grip(cell.robot, 0.02, 10.0))
    assert error.code is Code.CONTROLLER_LOST and "'panda_1/gripper'" in error.reason and "fingers" in error.reason


def test_a_trajectory_that_starts_elsewhere_is_not_sent(cell):
    with pytest.raises(ExecutionError, match="panda_joint1 at .* which is measured at .*; at most 0.03 rad") as error:
        cell.controllers.move(cell.robot, swing(cell.robot, begin=0.1))
    assert error.value.code is Code.TRACKING_LOST and not Client.goals
    cell.controllers.move(cell.robot, swing(cell.robot, begin=0.02))
    assert len(Client.goals) == 1


def test_nothing_moves_on_when_nothing_is_measured(cell, monkeypatch):
    monkeypatch.setattr(Client, "handle", Handle())
    command = cell.controllers.move(cell.robot, swing(cell.robot))
    cell.monitor.fresh = False
    error = outcome(cell, command)
    assert error.code is Code.STALE_STATE and Client.handle.canceled


@pytest.mark.parametrize(("meaning", "position"), [("gap", 0.06), ("finger", 0.03), ("joint", 0.03)])
def test_positions_of_grippers_mean_what_the_driver_takes(cell, meaning, position):
    gripper = cell.robot.model.gripper
    wire = GripperPosition(meaning)
    assert wire.position(gripper, 0.06) == pytest.approx(position)
    assert wire.opening(gripper, position) == pytest.approx(0.06)


def test_the_joint_of_a_turning_finger_and_an_unknown_meaning():
    gripper, wire = load_robot_model("ur5e_2f85").gripper, GripperPosition("joint")
    for opening in (0.0, 0.02, 0.05, 0.08):
        assert wire.position(gripper, opening) == pytest.approx(gripper.joints(opening)[0])
        assert wire.opening(gripper, wire.position(gripper, opening)) == pytest.approx(opening, abs=1e-5)
    with pytest.raises(InputError, match="gripper_position = 'width': unknown; allowed: gap, finger, joint"):
        GripperPosition("width")
