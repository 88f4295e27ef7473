"""Joint states are read field by field; the field that is wrong is named with its own numbers."""

import pytest

from hmap_msgs_py.checks import ConversionError, frame, joint_readings

NAN, INF = float("nan"), float("inf")
WANTED = {"a", "b"}


def test_what_is_not_needed_is_ignored():
    readings = joint_readings(["other", "b", "", "a", ""], [NAN, 2.0, INF, 1.0, 0.0], [NAN, 0.2, INF, 0.1, 0.0], WANTED)
    assert readings.values == {"a": (1.0, 0.1), "b": (2.0, 0.2)}
    assert not readings.refused and not readings.ignored


@pytest.mark.parametrize("velocity", [NAN, INF, -INF])
def test_bad_velocity_costs_only_itself(velocity):
    readings = joint_readings(["a", "b"], [1.0, 2.0], [velocity, 0.2], WANTED)
    assert readings.values == {"a": (1.0, 0.0), "b": (2.0, 0.2)}
    assert not readings.refused and len(readings.ignored) == 1
    assert f"velocity of joint 'a' is {velocity}" in readings.ignored[0]


def test_wrong_number_of_velocities_is_told_with_that_number():
    names = [f"j{i}" for i in range(9)]
    readings = joint_readings(names, [0.0] * 9, [0.0] * 7, set(names))
    assert len(readings.values) == 9
    assert "9 names and 7 velocities" in readings.ignored[0]


def test_wrong_number_of_positions_is_told_with_that_number():
    readings = joint_readings(["a", "b"], [0.0] * 3, [0.0] * 2, WANTED)
    assert not readings.values and "2 names and 3 positions" in readings.refused[0]
    assert "0 names and 1 positions" in joint_readings([], [0.0], [], WANTED).refused[0]


@pytest.mark.parametrize("position", [NAN, INF])
def test_bad_position_costs_only_its_joint(position):
    readings = joint_readings(["a", "b"], [position, 2.0], [], WANTED)
    assert readings.values == {"b": (2.0, 0.0)}
    assert f"position of joint 'a' is {position}" in readings.refused[0]


def test_joint_that_is_named_twice_is_not_used():
    readings = joint_readings(["a", "b", "a"], [1.0, 2.0, 3.0], [], WANTED)
    assert readings.values == {"b": (2.0, 0.0)}
    assert "'a' 2 times" in readings.refused[0]
    assert not joint_readings(["x", "x", "a"], [1.0, 2.0, 3.0], [], WANTED).refused  # of another robot


def test_joint_states_of_others_are_not_judged():
    readings = joint_readings(["x", "y"], [0.0], [], WANTED)
    assert not readings.values and not readings.refused and not readings.ignored
    assert not joint_readings([], [], [], WANTED).refused


def test_frame():
    frame("pose", "world", ["world", "vicon"])
    frame("pose", "/vicon", ["world", "vicon"])
    for wrong in ("map", "", "World"):
        with pytest.raises(ConversionError, match=f"pose is in frame {wrong!r}; allowed: 'vicon', 'world'"):
            frame("pose", wrong, ["world", "vicon"])
