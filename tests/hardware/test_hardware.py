"""Stand-ins of a Franka, its gripper and motion capture in place of the simulated world: goals, faults, remedies."""

import os
import time

import pytest
from cell import STEP, stand_in_cell

from hmap.commands.doctor import examine
from hmap_core.exceptions import Code

os.environ["ROS_DOMAIN_ID"] = str(20 + os.getpid() % 80)
# a task of one arm that needs a single contact
TASK = """
schema: 1
description: Carry a brick along a table.
mode: physical
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.1], pose: {xyz: [0, 0, -0.05]}}
movable:
  brick:
    shape: box
    size: [0.05, 0.05, 0.08]
    pose: {xyz: [0.5, -0.2, 0.04], rpy_deg: [0, 0, 20]}
    mass: 0.3
    friction: 0.6
robots:
  arm: {model: fr3, base: {xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}
goal: {object: brick, pose: {xyz: [0.5, 0.2, 0.04]}}
"""
PATIENCE = 0.6  # s for a world state
SETTLE = 1.2  # s for perception to notice a fault


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    (folder / "brick.yaml").write_text(TASK)
    options = {"state_patience": PATIENCE, "service_patience": 30.0, "controller_timeout": 1.5, "replans": 0}
    with stand_in_cell("brick.yaml", ["franka_ros2", "vicon_receiver"], folder, {}, **options) as cell:
        cell.folder = folder
        yield cell
    log = "".join(path.read_text() for path in (folder / "logs").glob("*.log"))
    assert "Traceback" not in log


@pytest.fixture
def healthy(cell):
    """The cell without faults."""
    cell.fault("clear")
    time.sleep(0.2)
    cell.wait_until_measuring()
    yield cell
    cell.fault("clear")


def named_by_doctor() -> str:
    return "\n".join(f"{f.level} {f.what}: {f.text}" for f in examine(0.6) if f.level == "FAIL")


@pytest.mark.slow
def test_the_doctor_finds_nothing_wrong_and_the_goal_is_reached(healthy):
    assert named_by_doctor() == ""
    result = healthy.goal()
    assert result.success and result.executed, result.error
    assert result.position_error < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "told"),
    [
        (["poses drop", "joints names"], ["/vicon/brick/brick: no message came", "lacks fr3_joint1, fr3_joint2"]),
        (["poses old", "joints nan"], ["stale: the newest stamp is 10.", "positions of fr3_joint1, fr3_joint2"]),
        (["poses frame", "joints drop"], ["is in frame 'elsewhere', which neither", "/joint_states: no message came"]),
        (["poses w first"], ["does its driver send w first?"]),
        (["poses unstamped"], ["its stamps are 0"]),
    ],
)
def test_the_doctor_names_input_that_cannot_be_right(healthy, faults, told):
    for fault in faults:
        healthy.fault(fault)
    time.sleep(0.3)
    found = named_by_doctor()
    assert all(text in found for text in told), found


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        "poses drop",
        "poses old",
        "poses ahead",
        "poses nan",
        "poses unnormalised",
        "poses frame",
        "joints drop",
        "joints nan",
    ],
)
def test_on_input_that_cannot_be_right_nothing_moves(healthy, fault):
    healthy.fault(fault)
    time.sleep(SETTLE)
    began = time.monotonic()
    result = healthy.goal()
    assert result.error is not None and result.error.code is Code.STALE_STATE and not result.executed
    assert healthy.moved_after(began) < STEP


@pytest.mark.slow
def test_a_pose_that_jumps_is_named_and_not_used_until_it_stays(healthy):
    healthy.fault("poses jump")
    time.sleep(0.2)
    healthy.fault("clear")
    time.sleep(0.5)
    assert "the pose of 'brick' has jumped by 0." in (healthy.folder / "logs" / "perception.log").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code", "says"),
    [
        ("arm mute", Code.CONTROLLER_LOST, "it has not answered for"),
        ("arm stand", Code.CONTROLLER_LOST, "is lost: it does not"),
        ("arm reflex", Code.TRACKING_LOST, "reflex"),
        ("poses drop", Code.STALE_STATE, "world state"),
    ],
)
def test_faults_of_controllers_have_their_codes_and_the_arm_stands(healthy, fault, code, says):
    result = healthy.goal("execution", lambda: healthy.fault(fault), **back(healthy))
    assert result.error is not None and result.error.code is code, result.error
    assert says in result.error.reason
    began = time.monotonic()
    time.sleep(0.5)
    assert healthy.moved_after(began) < STEP


def back(cell) -> dict:
    """A goal at the side of the table where the brick is not."""
    y = cell.session.world_state().poses["brick"][1]
    return {"object": "brick", "pose": [0.5, -0.2 if y > 0.0 else 0.2, 0.04, 0.0, 0.0, 0.0, 1.0]}
