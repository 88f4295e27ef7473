"""The judge on objects that two hands carry: grasps that are torn, who carries how much, a hand that lets go."""

import copy

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.validation import Kind, check
from hmap_core.validation.shared import lever_shares

MASS = 4.0  # kg
LENGTH = 0.5  # m
ENDS = (-0.15, 0.15)  # m along the bar, where it is grasped
SECOND_BASE = (0.0, -0.2, 0.0)  # so that the posts of both gantries are apart
LIFT = (1.4, 2.0)  # s of the plan in which the bar rises


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


def carry(urdf: str, ends=ENDS, payload: float = MASS) -> dict:
    """A valid physical plan: two gantries grasp a bar at the same time, carry it by 10 cm, and place it."""
    a, b = ends
    bodies = [plans.table(), plans.box("bar", (LENGTH, plans.SIDE, plans.SIDE), (0.0, 0.0, plans.SIDE / 2))]
    bodies[1]["mass"] = MASS
    board = plans.Storyboard((a, 0.0, plans.ABOVE), plans.OPEN, bodies, robot="first")
    board.move("transit", (a, 0.0, plans.GRASP_Z), 1.0)
    board.move("transit", (a, 0.0, plans.GRASP_Z), 0.4, opening=plans.SIDE)
    board.move("grasp", (a, 0.0, 0.1), 0.6, carries=("bar",))
    board.move("grasp", (a, 0.1, 0.1), 0.8, carries=("bar",))
    board.move("grasp", (a, 0.1, plans.GRASP_Z), 0.6, carries=("bar",))
    board.move("transit", (a, 0.1, plans.GRASP_Z), 0.4, opening=plans.OPEN)
    board.move("transit", (a, 0.1, plans.ABOVE), 1.0)
    plan = board.plan(urdf, plans.goal("bar", (0.0, 0.1, plans.SIDE / 2)), "physical")
    shift = np.array([b - a, 0.0, 0.0]) - SECOND_BASE
    q = np.array(plan["trajectory"]["joints"]["first"]) + shift
    second = plans.gantry(urdf, q[0]) | {"base_pose": plans.pose(*SECOND_BASE)}
    plan["robots"]["second"] = second | {"q_start": q[0].tolist()}
    plan["trajectory"]["joints"]["second"] = q.tolist()
    plan["trajectory"]["gripper"]["second"] = list(plan["trajectory"]["gripper"]["first"])
    for segment in list(plan["segments"]):
        own = copy.deepcopy(segment) | {"robot": "second"}
        if own["contact_pose"] is not None:
            own["contact_pose"][0] += b - a
        plan["segments"].append(own)
    for robot in plan["robots"].values():
        robot["payload"] = payload
    return plan


def drifting(plan: dict, robot: str, amount: float) -> dict:
    """The plan with a hand that slides along the bar by an amount (m) while the bar rises, and stays there."""
    time = np.array(plan["trajectory"]["time"])
    u = np.clip((time - LIFT[0]) / (LIFT[1] - LIFT[0]), 0.0, 1.0)
    q = np.array(plan["trajectory"]["joints"][robot])
    q[:, 0] += amount * (10 * u**3 - 15 * u**4 + 6 * u**5)
    plan["trajectory"]["joints"][robot] = q.tolist()
    return plan


def test_two_hands_share_a_weight_that_none_carries_alone(urdf):
    report = check(carry(urdf, payload=0.51 * MASS))
    assert report.valid, report.violations


@pytest.mark.parametrize(("payload", "valid"), [(0.68, True), (0.65, False)])
def test_each_hand_carries_the_share_of_its_lever_arm(urdf, payload, valid):
    report = check(carry(urdf, ends=(-0.2, 0.1), payload=payload * MASS))
    assert report.valid is valid, report.violations
    if not valid:
        assert plans.kinds(report) == {"payload"}
        found = plans.worst(report, Kind.PAYLOAD)
        assert found.bodies == ("second/hand", "bar")  # it is nearer to the centre of mass
        assert found.amount == pytest.approx(2.0 / 3.0 * MASS, rel=1e-3)


def test_shares_balance_the_moments():
    points = np.array([[[-0.2, 0.0], [0.1, 0.0], [0.0, 0.3]], [[0.1, 0.1], [0.101, 0.1], [0.1, 0.101]]])
    centre = np.array([[0.0, 0.05], [0.0, 0.0]])
    shares = lever_shares(points, centre)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    np.testing.assert_allclose(shares[0] @ points[0], centre[0], atol=1e-12)
    np.testing.assert_allclose(shares[1], 1.0 / 3.0)  # hands at one place carry alike


def test_a_hand_that_slides_away_from_the_other_tears_the_grasp(urdf):
    report = check(drifting(carry(urdf), "second", 0.004))
    assert {"torn_grasp", "slip"} <= plans.kinds(report)
    found = plans.worst(report, Kind.TORN_GRASP)
    assert found.bodies == ("first/hand", "second/hand", "bar")
    assert found.amount == pytest.approx(0.004, rel=1e-3)


def test_two_small_slips_in_opposite_directions_tear_the_grasp(urdf):
    report = check(drifting(drifting(carry(urdf), "first", -0.0008), "second", 0.0008))
    assert plans.kinds(report) == {"torn_grasp"}
    assert plans.worst(report, Kind.TORN_GRASP).amount == pytest.approx(0.0016, rel=1e-3)


def test_a_hand_that_lets_go_at_the_top_leaves_the_weight_to_the_other(urdf):
    plan = carry(urdf, payload=0.6 * MASS)
    assert check(plan).valid
    aside = [s for s in plan["segments"] if s["robot"] == "second" and s["kind"] == "grasp"]
    for segment in aside[1:]:  # from the top on; the fingers stay where they are round the bar
        segment |= {"kind": "transit", "object": None, "contact_pose": None}
    report = check(plan)
    found = plans.worst(report, Kind.PAYLOAD)
    assert found.bodies == ("first/hand", "bar") and found.amount == pytest.approx(MASS)


def test_fingers_that_open_at_the_top_are_missing(urdf):
    plan = carry(urdf)
    openings = plan["trajectory"]["gripper"]["second"]
    begin, end = plans.sample(plan, 2.1), plans.sample(plan, 2.5)
    for k in range(begin, len(openings)):
        openings[k] = max(openings[k], plans.SIDE + 0.01 * min(1.0, (k - begin) / (end - begin)))
    found = plans.worst(check(plan), Kind.CONTACT_MISSING)
    assert found.bodies == ("second/hand", "bar")
