"""When the world is too far off a plan, and what of a measurement is noise."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.execution.drift import DRIFT_POSITION, DRIFT_ROTATION, DriftTolerance, drift_reason
from hmap_core.trajectory.measured import HEIGHT_NOISE, JOINT_NOISE, TILT_NOISE, upright, without_noise
from hmap_core.transforms import distance, from_rpy, pose
from hmap_core.types import BodyKind, Scene

PLANNED = {"box": pose((0.5, 0.0, 0.03)), "stick": from_rpy((0.2, 0.3, 0.02), (0.0, 0.0, 1.0))}


@pytest.fixture
def world() -> Scene:
    wall = box("wall", (0.1, 0.1, 0.1), (0.0, 0.6, 0.05), BodyKind.FIXED)
    return scene(box("box", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03)), wall)


def off(name: str, by=(0.0, 0.0, 0.0), turn: float = 0.0) -> dict[str, np.ndarray]:
    """The planned poses with one body moved and turned about the vertical."""
    moved = PLANNED[name].copy()
    yaw = 2.0 * np.arctan2(moved[5], moved[6]) + turn
    return PLANNED | {name: from_rpy(moved[:3] + by, (0.0, 0.0, yaw))}


def test_what_is_where_it_is_planned_has_not_drifted():
    assert drift_reason(PLANNED, off("box")) is None


@pytest.mark.parametrize("share, drifted", [(0.98, False), (1.02, True)])
def test_the_limits_are_those_of_the_tolerance(share, drifted):
    assert (drift_reason(PLANNED, off("box", (share * DRIFT_POSITION, 0, 0))) is not None) == drifted
    assert (drift_reason(PLANNED, off("stick", turn=-share * DRIFT_ROTATION)) is not None) == drifted
    wide = DriftTolerance(position=0.03, rotation=0.2)
    assert (drift_reason(PLANNED, off("box", (0.0, -share * 0.03, 0)), wide) is not None) == drifted
    assert (drift_reason(PLANNED, off("box", turn=share * 0.2), wide) is not None) == drifted


def test_the_reason_names_the_body_that_is_off_the_most():
    measured = off("box", (0.011, 0, 0)) | {"stick": off("stick", (0.0, 0.02, 0))["stick"], "new": pose((9, 9, 9))}
    reason = drift_reason(PLANNED, measured)
    assert reason.startswith("'stick' is 20.0 mm and 0.0 deg off") and "10.0 mm and 5.0 deg are allowed" in reason


def test_a_pose_that_is_no_number_has_drifted():
    assert "'box'" in drift_reason(PLANNED, PLANNED | {"box": np.full(7, np.nan)})


def test_noise_in_height_and_tilt_is_taken_out_and_the_rest_is_kept():
    planned = from_rpy((0.5, 0.0, 0.03), (np.pi / 2, 0.0, 0.3))
    turned = from_rpy((0.52, -0.04, 0.03), (np.pi / 2, 0.0, 1.1))
    measured = from_rpy((0.52, -0.04, 0.0297), (np.pi / 2 + 0.004, 0.0, 1.1))
    assert distance(upright(measured, planned), turned) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-6))


@pytest.mark.parametrize("change", [(1.1 * HEIGHT_NOISE, 0.0), (-1.1 * HEIGHT_NOISE, 0.0), (0.0, 1.1 * TILT_NOISE)])
def test_a_body_that_stands_elsewhere_is_left_as_it_was_measured(change):
    measured = from_rpy((0.5, 0.0, 0.03 + change[0]), (change[1], 0.0, 0.2))
    np.testing.assert_array_equal(upright(measured, pose((0.5, 0.0, 0.03))), measured)


def test_joints_and_fingers_are_where_they_are_held(world):
    planned = world.start_state()
    measured = planned.copy()
    measured.q["left"] += [0.5 * JOINT_NOISE, -2.0 * JOINT_NOISE, 0, 0, 0, 0, 0]
    measured.gripper["left"] -= 4e-4
    clean = without_noise(world, measured, planned)
    np.testing.assert_array_equal(clean.q["left"], planned.q["left"] - [0, 2.0 * JOINT_NOISE, 0, 0, 0, 0, 0])
    assert clean.gripper["left"] == planned.gripper["left"]
    measured.gripper["left"] = 0.05
    assert without_noise(world, measured, planned).gripper["left"] == 0.05


def test_what_is_beyond_a_limit_is_brought_back(world):
    robot = world.robots["left"]
    planned, measured = world.start_state(), world.start_state()
    measured.q["left"][3] = robot.model.position_limits[1, 3] + 0.01
    measured.gripper["left"] = robot.model.gripper.open_opening + 0.0015
    clean = without_noise(world, measured, planned)
    assert clean.q["left"][3] == robot.model.position_limits[1, 3]
    assert clean.gripper["left"] == robot.model.gripper.open_opening


def test_fixed_bodies_are_where_the_scene_has_them_and_unknown_bodies_do_not_count(world):
    measured = world.start_state()
    measured.poses["wall"] = measured.poses["wall"] + np.r_[1e-5, np.zeros(6)]
    measured.poses["detected object"] = pose()
    clean = without_noise(world, measured, world.start_state())
    np.testing.assert_array_equal(clean.poses["wall"], world.bodies["wall"].pose)
    assert clean.poses.keys() == world.bodies.keys()


def test_a_robot_without_gripper_keeps_its_opening(world):
    robot = world.robots["left"]
    bare = replace(world, robots={"left": replace(robot, model=replace(robot.model, gripper=None))})
    assert without_noise(bare, bare.start_state(), bare.start_state()).gripper == {"left": 0.0}
