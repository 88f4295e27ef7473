"""What the sensors say becomes one state, with the age of its oldest part."""

import numpy as np
import pytest

from hmap.perception.fusion import Fusion
from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import load_scene
from hmap_msgs_py.checks import PoseError
from hmap_msgs_py.measurements import ReceiverClock, StampError

JOINTS = 7
AHEAD = 1.0  # s
NAN, INF = float("nan"), float("inf")


def fusion_with(clock=None) -> Fusion:
    scene = load_scene("tunnel", 0)
    arms = {robot: [f"{robot}_{i}" for i in range(JOINTS)] for robot in scene.robots}
    fingers = {robot: [f"{robot}_left", f"{robot}_right"] for robot in scene.robots}
    return Fusion(scene, arms, fingers, clock)


@pytest.fixture
def fusion():
    return fusion_with()


def feed(fusion, time: float, robot: str) -> None:
    names = [f"{robot}_{i}" for i in range(JOINTS)] + [f"{robot}_left", f"{robot}_right"]
    positions = [0.1 * i for i in range(JOINTS)] + [0.02, 0.02]
    order = np.random.default_rng(0).permutation(len(names))
    fusion.add_joints(time, [names[i] for i in order], [positions[i] for i in order], [])


def test_state_is_matched_by_name_and_as_old_as_its_oldest_part(fusion):
    feed(fusion, 3.0, "panda_1")
    feed(fusion, 2.0, "panda_2")
    fusion.add_pose(4.0, "bar", transforms.pose((1.0, 2.0, 3.0)))
    time, state, velocity = fusion.state()
    assert time == 2.0
    assert np.allclose(state.q["panda_1"], 0.1 * np.arange(JOINTS))
    assert state.gripper["panda_2"] == pytest.approx(0.04)  # two fingers at 2 cm each
    assert np.allclose(state.poses["bar"][:3], [1.0, 2.0, 3.0])
    assert np.allclose(state.poses["table"], fusion.scene.bodies["table"].pose)
    assert np.allclose(velocity["panda_1"], 0.0)


def test_what_was_never_measured_is_named(fusion):
    feed(fusion, 1.0, "panda_1")
    with pytest.raises(InputError, match="panda_2_0.*bar") as caught:
        fusion.state()
    assert caught.value.code is Code.STALE_STATE


@pytest.mark.parametrize("positions", [[], [float("nan")], [0.0, 1.0]])
def test_wrong_joint_states_are_refused(fusion, positions):
    with pytest.raises(InputError):
        fusion.add_joints(0.0, ["panda_1_0"], positions, [])


def test_pose_nearest_in_time_is_found(fusion):
    for time in (1.0, 2.0, 3.0):
        fusion.add_pose(time, "bar", transforms.pose((0.1 * time, 0.0, 0.0)))
    assert fusion.pose_at("bar", 2.2)[0] == pytest.approx(0.2)
    assert fusion.pose_at("table", 2.0) is None


def complete(fusion, time: float) -> None:
    for robot in fusion.scene.robots:
        feed(fusion, time, robot)
    fusion.add_pose(time, "bar", transforms.pose((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("velocity", [NAN, INF])
def test_bad_velocity_blocks_nothing_and_is_named(fusion, velocity):
    complete(fusion, 1.0)
    names = [f"panda_1_{i}" for i in range(JOINTS)]
    problems = fusion.add_joints(2.0, names, [0.5] * JOINTS, [0.1, velocity, *[0.1] * (JOINTS - 2)])
    assert len(problems) == 1 and "velocity of joint 'panda_1_1'" in problems[0]
    _, state, velocities = fusion.state()
    assert np.allclose(state.q["panda_1"], 0.5)
    assert velocities["panda_1"].tolist() == [0.1, 0.0, *[0.1] * (JOINTS - 2)]


def test_wrong_number_of_velocities_is_told_and_positions_are_used(fusion):
    complete(fusion, 1.0)
    names = [f"panda_1_{i}" for i in range(JOINTS)]
    (problem,) = fusion.add_joints(2.0, names, [0.5] * JOINTS, [0.0] * 5)
    assert "7 names and 5 velocities" in problem
    assert np.allclose(fusion.state()[1].q["panda_1"], 0.5)


def test_bad_position_keeps_the_one_of_before_and_its_age(fusion):
    complete(fusion, 1.0)
    names = [f"panda_1_{i}" for i in range(JOINTS)]
    (problem,) = fusion.add_joints(2.0, names, [0.5, NAN, *[0.5] * (JOINTS - 2)], [])
    assert "position of joint 'panda_1_1'" in problem
    feed(fusion, 2.0, "panda_2")
    fusion.add_pose(2.0, "bar", transforms.pose((0.0, 0.0, 0.0)))
    time, state, _ = fusion.state()
    assert state.q["panda_1"][:2].tolist() == [0.5, 0.1]
    assert time == 1.0 and fusion.oldest() == (1.0, "joint 'panda_1_1'")


def test_joints_of_other_robots_are_no_problem(fusion):
    complete(fusion, 1.0)
    assert fusion.add_joints(1.0, ["ur5_elbow", "panda_1_0"], [NAN, 0.3], [NAN, 0.0]) == []
    assert fusion.state()[1].q["panda_1"][0] == 0.3


def test_older_joint_states_and_poses_replace_nothing(fusion):
    complete(fusion, 5.0)
    fusion.add_joints(4.0, ["panda_1_0"], [9.0], [])
    fusion.add_pose(4.0, "bar", transforms.pose((9.0, 0.0, 0.0)))
    time, state, _ = fusion.state()
    assert time == 5.0 and state.q["panda_1"][0] == 0.0 and state.poses["bar"][0] == 0.0
    assert fusion.pose_at("bar", 4.0)[0] == 9.0  # it is still what was measured then


def test_stamps_ahead_of_the_clock_are_refused(fusion):
    fusion = fusion_with(ReceiverClock(lambda: 100.0, AHEAD))
    complete(fusion, 99.5)
    with pytest.raises(StampError, match="'bar' is stamped 3600.00 s ahead"):
        fusion.add_pose(3700.0, "bar", transforms.pose((9.0, 0.0, 0.0)))
    with pytest.raises(StampError, match="joint state is stamped 3600.00 s ahead"):
        fusion.add_joints(3700.0, ["panda_1_0"], [9.0], [])
    time, state, _ = fusion.state()
    assert time == 99.5 and state.poses["bar"][0] == 0.0 and state.q["panda_1"][0] == 0.0


def test_simulation_that_is_started_anew_is_followed(fusion):
    now = [100.0]
    fusion = fusion_with(ReceiverClock(lambda: now[0], AHEAD))
    complete(fusion, 99.9)
    now[0] = 0.3
    with pytest.raises(InputError, match="not measured yet"):  # nothing of the run before counts
        fusion.state()
    complete(fusion, 0.2)
    assert fusion.state()[0] == 0.2


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (0, 0, 0, 2), (0, 0, 0, NAN), (0, 0, 0, INF)])
def test_malformed_poses_are_refused_and_named(fusion, quaternion):
    with pytest.raises(PoseError, match="bar"):
        fusion.add_pose(1.0, "bar", np.array([0.0, 0.0, 0.0, *quaternion]))


def test_pose_of_a_body_that_has_left_the_scene_is_ignored(fusion):
    fusion.add_pose(1.0, "gone", transforms.pose((0.0, 0.0, 0.0)))


def test_rounded_quaternions_are_normalised(fusion):
    complete(fusion, 1.0)
    fusion.add_pose(1.0, "bar", np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0005]))
    assert fusion.state()[1].poses["bar"][6] == 1.0
