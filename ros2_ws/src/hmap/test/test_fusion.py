"""What the sensors say becomes one state, with the age of its oldest part."""

import numpy as np
import pytest

from hmap.perception.fusion import Fusion
from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import load_scene

JOINTS = 7


@pytest.fixture
def fusion():
    scene = load_scene("tunnel", 0)
    arms = {robot: [f"{robot}_{i}" for i in range(JOINTS)] for robot in scene.robots}
    fingers = {robot: [f"{robot}_left", f"{robot}_right"] for robot in scene.robots}
    return Fusion(scene, arms, fingers)


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
        fusion.add_pose(time, "bar", transforms.pose((time, 0.0, 0.0)))
    assert fusion.pose_at("bar", 2.2)[0] == 2.0
    assert fusion.pose_at("table", 2.0) is None
