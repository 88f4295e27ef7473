"""The judge weighs what grippers hold and arms carry or push; files that name no mass, force or payload stay valid."""

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.validation import Kind, check

MASS = 2.0  # kg
WEIGHT = MASS * 9.81  # N


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


def weighed(plan: dict, mass: float = MASS, force: float | None = None, payload: float | None = None) -> dict:
    """The plan, in physical mode, with the cube's mass and what the robot is able to."""
    plan["mode"] = "physical"
    next(body for body in plan["scene"]["bodies"] if body["name"] == "cube")["mass"] = mass
    robot = plan["robots"]["gantry"]
    if force is not None:
        robot["gripper"]["force"] = force
    if payload is not None:
        robot["payload"] = payload
    return plan


def lift_acceleration(plan: dict) -> float:
    """Largest |acceleration - gravity| of the cube while it is held, m/s^2."""
    poses = np.array(plan["trajectory"]["objects"]["cube"])[:, :3]
    return float(np.linalg.norm(np.diff(poses, 2, axis=0) / plans.DT**2 + [0.0, 0.0, 9.81], axis=1).max())


def test_grip_force_counts_with_the_acceleration_of_the_motion(urdf):
    plan = plans.carry(urdf)
    worst = MASS * lift_acceleration(plan)
    assert worst > 1.02 * WEIGHT
    enough, short = 1.001 * worst, 0.95 * worst  # N that two pads with friction 0.5 hold is their force
    assert check(weighed(plan, force=enough)).valid
    report = check(weighed(plan, force=short))
    assert plans.kinds(report) == {"grip_force"}
    found = plans.worst(report, Kind.GRIP_FORCE)
    assert set(found.bodies) == {"gantry/hand", "cube"}
    assert found.amount == pytest.approx(worst, rel=1e-3) and found.limit == pytest.approx(1.02 * short)


def test_friction_of_the_fingers_counts_where_it_is_lower(urdf):
    plan = weighed(plans.carry(urdf), force=60.0)
    assert check(plan).valid
    plan["robots"]["gantry"]["simulation"] = {"finger_friction": 0.1}
    assert plans.kinds(check(plan)) == {"grip_force"}


def test_payload_of_the_arm(urdf):
    assert check(weighed(plans.carry(urdf), payload=MASS)).valid
    report = check(weighed(plans.carry(urdf), payload=0.9 * MASS))
    assert plans.kinds(report) == {"payload"}
    found = plans.worst(report, Kind.PAYLOAD)
    assert (found.amount, found.limit) == (MASS, pytest.approx(0.9 * MASS))


def test_files_without_force_and_payload_stay_valid(urdf):
    assert check(weighed(plans.carry(urdf), mass=1000.0)).valid


def test_what_slides_on_its_support_is_not_lifted(urdf):
    plan = weighed(plans.carry(urdf), force=5.0, payload=1.01)  # the friction of 2 kg is that of lifting 1 kg
    assert not check(plan).valid
    for poses, joints in zip(
        plan["trajectory"]["objects"]["cube"], plan["trajectory"]["joints"]["gantry"], strict=True
    ):
        joints[2] -= poses[2] - plans.SIDE / 2
        poses[2] = plans.SIDE / 2
    assert not {"grip_force", "payload"} & plans.kinds(check(plan))


@pytest.mark.parametrize(("payload", "valid"), [(1.1, True), (0.9, False)])
def test_push_against_friction_with_the_support(urdf, payload, valid):
    report = check(weighed(plans.push(urdf, friction=0.5), payload=payload))  # 2 kg with friction 0.5
    assert report.valid is valid
    if not valid:
        assert plans.kinds(report) == {"payload"}
        assert plans.worst(report, Kind.PAYLOAD).amount == pytest.approx(1.0)


def test_weights_do_not_count_in_kinematic_plans(urdf):
    plan = weighed(plans.carry(urdf), force=1.0, payload=0.1)
    plan["mode"] = "kinematic"
    assert check(plan).valid
