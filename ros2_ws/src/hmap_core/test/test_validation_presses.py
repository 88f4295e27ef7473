"""The judge's rules for presses, which drag an object by friction on its top, and faulty versions of a valid one."""

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.exceptions import Code, InputError
from hmap_core.validation import Kind, check

TOP = plans.PLATE[2] + plans.TIP  # m, of the hand on the plate
FINGER = 0.02  # m, along x
WEIGHT = 0.2 * 9.81  # N
FRICTION = 0.5  # of the plate


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


@pytest.mark.parametrize("to", [(0.15, 0.0), (0.0, -0.2), (-0.1, 0.1)])
def test_press_that_drags_is_valid(urdf, to):
    report = check(plans.press(urdf, to))
    assert report.valid, report.violations


def test_too_little_force_slips(urdf):
    """A straight drag through the centre of mass needs the force N with mu N = mu mu_table (N + W)."""
    least = 0.6 * WEIGHT / (1.0 - 0.6)
    assert check(plans.press(urdf, force=1.03 * least)).valid
    report = check(plans.press(urdf, force=0.9 * least))
    assert plans.kinds(report) == {"press_friction"}
    found = plans.worst(report, Kind.PRESS_FRICTION)
    assert set(found.bodies) == {"gantry/hand", "plate"}
    needed = 0.6 * (0.9 * least + WEIGHT)
    assert found.amount == pytest.approx(needed, rel=0.03) and found.limit == pytest.approx(1.02 * 0.9 * least)


def test_fingers_that_are_as_smooth_as_the_table_drag_nothing(urdf):
    plan = plans.press(urdf, force=20.0)
    plan["robots"]["gantry"]["simulation"] = {"finger_friction": 0.6}
    assert plans.kinds(check(plan)) == {"press_friction"}


def test_press_beside_the_middle_needs_friction_against_turning(urdf):
    """The friction of the weight acts 4 cm beside the fingers, which are 2 cm wide."""
    beside = (0.0, 0.04, TOP)
    assert plans.kinds(check(plans.press(urdf, force=3.2, at=beside))) == {"press_friction"}
    assert check(plans.press(urdf, (0.0, 0.15), force=3.2, at=beside)).valid


def test_finger_beside_the_object_is_no_press(urdf):
    behind = (-plans.PLATE[0] / 2 - FINGER / 2, 0.0, plans.TIP + 0.001)
    report = check(plans.press(urdf, at=behind))
    assert "press_direction" in plans.kinds(report)
    found = plans.worst(report, Kind.PRESS_DIRECTION)
    assert found.amount == pytest.approx(90.0, abs=1.0) and found.limit == pytest.approx(10.0)


def test_press_that_lifts_its_object(urdf):
    assert check(plans.press(urdf, rise=0.0005)).valid
    report = check(plans.press(urdf, rise=0.02))
    assert "press_lifted" in plans.kinds(report)
    assert plans.worst(report, Kind.PRESS_LIFTED).amount == pytest.approx(0.02, abs=1e-3)


def test_press_on_the_part_that_sticks_out_tips_the_object(urdf):
    """The centre of mass stays on the table, that of weight and pressing force together does not."""
    outside = (0.045, 0.0, TOP)
    assert check(plans.press(urdf, force=10.0, at=outside)).valid
    report = check(plans.press(urdf, force=10.0, at=outside, table_end=0.17))
    assert plans.kinds(report) == {"press_lifted"}
    assert check(plans.press(urdf, force=10.0, at=(-0.045, 0.0, TOP), table_end=0.17)).valid


@pytest.mark.parametrize("follows", [True, False])
def test_a_book_that_is_tilted_about_its_edge_is_not_pressed_on_its_support(urdf, follows):
    """A finger on top tilts the object about its lower edge at the back; it slips where the hand does not follow."""
    plan = plans.press(urdf, (0.0, 0.0), force=10.0)
    time = np.arange(len(plan["trajectory"]["time"])) * plans.DT
    tilt = np.interp(time, [1.0, 2.0, 3.0], [0.0, 0.1, 0.0])
    half, poses = np.array([plans.PLATE[0] / 2, plans.PLATE[2] / 2]), np.array(plan["trajectory"]["objects"]["plate"])
    poses[:, 0] = half[1] * np.sin(tilt) + half[0] * np.cos(tilt) - half[0]
    poses[:, 2] = half[1] * np.cos(tilt) + half[0] * np.sin(tilt)
    poses[:, 4], poses[:, 6] = -np.sin(tilt / 2), np.cos(tilt / 2)
    plan["trajectory"]["objects"]["plate"] = poses.tolist()
    if follows:
        for k, q in enumerate(plan["trajectory"]["joints"]["gantry"]):
            q[0] += poses[k, 0]
            q[2] += poses[k, 2] - half[1]
    found = plans.kinds(check(plan))
    assert "press_lifted" in found and "slip" in found


def test_fingers_that_lift_off_leave_the_object_behind(urdf):
    plan = plans.press(urdf)
    hold = [k for k, t in enumerate(plan["trajectory"]["time"]) if 1.6 < t < 2.4]
    for k in hold:
        plan["trajectory"]["joints"]["gantry"][k][2] += 0.005
    assert {"contact_missing", "slip", "untouched_motion"} <= plans.kinds(check(plan))


def test_force_beyond_the_payload(urdf):
    plan = plans.press(urdf, force=20.0)
    assert check(plan).valid
    plan["robots"]["gantry"]["payload"] = 1.5
    report = check(plan)
    assert plans.kinds(report) == {"payload"}
    assert plans.worst(report, Kind.PAYLOAD).amount == pytest.approx(20.0 / 9.81)


def test_turning_about_the_fingers(urdf):
    """Fingers 2 cm wide resist little torque: a turn in place needs more force than a straight drag."""
    plan = plans.press(urdf, (0.0, 0.0))
    poses = np.array(plan["trajectory"]["objects"]["plate"])
    angle = np.interp(np.arange(len(poses)) * plans.DT, [1.0, 2.0, 3.0], [0.0, 0.2, 0.4])
    poses[:, 5], poses[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
    plan["trajectory"]["objects"]["plate"] = poses.tolist()
    assert "press_friction" in plans.kinds(check(plan))


@pytest.mark.parametrize("force", [0.0, -1.0, None, "5 N"])
def test_a_press_has_a_force(urdf, force):
    plan = plans.press(urdf)
    press = next(segment for segment in plan["segments"] if segment["kind"] == "press")
    press["force"] = force
    with pytest.raises(InputError, match="force") as failure:
        check(plan)
    assert failure.value.code is Code.INVALID_PLAN_FILE
    del press["force"]
    with pytest.raises(InputError, match="force"):
        check(plan)


def test_kinematic_plans_are_not_asked_for_friction(urdf):
    plan = plans.press(urdf, force=0.1)
    plan["mode"] = "kinematic"
    assert check(plan).valid
