"""Plans that are right pass, and the report says what it should."""

import json

import pytest
import validation_fixtures as plans

from hmap_core.validation import check


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


@pytest.mark.parametrize("make", [plans.carry, plans.touch, plans.push, plans.tool_use])
def test_valid_plan_is_accepted(urdf, make):
    report = check(make(urdf))
    assert report.violations == ()
    assert report.valid


def test_report_has_exactly_the_documented_keys(urdf):
    plan = plans.carry(urdf)
    plan["goal"]["pose"][0] += 0.1
    out = json.loads(json.dumps(check(plan).to_dict(), allow_nan=False))
    assert set(out) == {"valid", "violations", "goal_error", "min_clearance_m", "min_held_clearance_m"}
    assert set(out["goal_error"]) == {"position_m", "rotation_deg"}
    assert out["valid"] is False
    assert [set(v) for v in out["violations"]] == [{"kind", "bodies", "time", "amount", "limit"}]


def test_goal_error_is_measured_at_the_end(urdf):
    plan = plans.carry(urdf)
    plan["goal"]["pose"] = [0.203, 0.0, 0.03, 0.0, 0.0, 0.00872653, 0.99996192]  # 3 mm and one degree off
    report = check(plan)
    assert report.valid
    assert report.goal_error["position_m"] == pytest.approx(0.003, abs=1e-6)
    assert report.goal_error["rotation_deg"] == pytest.approx(1.0, abs=1e-3)


def test_clearance_is_that_of_the_nearest_pair_that_may_not_touch(urdf):
    # the cube, 10 cm up, passes 4 mm over a block's top while it is carried
    block = plans.box("block", (0.02, 0.02, 0.066), (0.1, 0.0, 0.033), "fixed")
    assert check(plans.carry(urdf, extra=(block,))).min_clearance_m == pytest.approx(0.004, abs=1e-6)


def test_clearance_without_any_pair_is_null(urdf):
    plan = plans.carry(urdf)
    for name in plan["trajectory"]["joints"]:
        plan["trajectory"]["joints"][name] = [plan["robots"][name]["q_start"]] * len(plan["trajectory"]["time"])
    plan["trajectory"]["gripper"]["gantry"] = [plans.OPEN] * len(plan["trajectory"]["time"])
    plan["trajectory"]["objects"] = {}
    plan["segments"] = [plans.segment(plan, "transit") | {"end": plan["trajectory"]["time"][-1]}]
    plan["goal"] = plans.goal("cube", (0.0, 0.0, 0.03))
    report = check(plan)
    assert report.valid and report.to_dict()["min_clearance_m"] is None


def test_an_object_that_never_moves_may_float(urdf):
    floating = plans.box("lamp", (0.05, 0.05, 0.05), (0.5, -0.5, 0.5))
    assert check(plans.carry(urdf, extra=(floating,))).valid


def test_a_base_standing_in_its_table_is_no_violation(urdf):
    # the gantry's post reaches from z = 0 to 1; a fixed slab is where its foot is
    slab = plans.box("slab", (0.3, 0.3, 0.2), (0.6, 0.6, 0.1), "fixed")
    assert check(plans.carry(urdf, extra=(slab,))).valid


def test_ignored_collisions_are_honoured(urdf):
    plan = plans.carry(urdf)
    plan["robots"]["gantry"]["base_pose"] = plans.pose(-0.5, -0.6, 0.0)  # the post now stands in the way
    for joints in (plan["trajectory"]["joints"]["gantry"], [plan["robots"]["gantry"]["q_start"]]):
        for q in joints:
            q[0], q[1] = q[0] + 0.5, q[1] + 0.6
    plan["robots"]["gantry"]["base_pose"][2] = 0.0
    assert plans.kinds(check(plan)) == {"penetration"}
    plan["robots"]["gantry"]["ignored_collisions"] = [["base", link] for link in ("hand", "left", "right")]
    assert plans.kinds(check(plan)) == {"penetration"}  # the attached cube still hits the post
    assert {v.bodies for v in check(plan).violations} == {("gantry/base", "cube")}


def test_the_same_plan_gets_the_same_report(urdf):
    plan = plans.carry(urdf)
    plan["goal"]["pose"][0] += 0.1
    assert check(plan).to_dict() == check(plan).to_dict()


def test_a_plan_with_nothing_to_do_has_one_sample(urdf):
    plan = plans.carry(urdf)
    for group in ("joints", "gripper", "objects"):
        for name, samples in plan["trajectory"][group].items():
            plan["trajectory"][group][name] = samples[:1]
    plan["trajectory"]["time"] = [0.0]
    plan["segments"] = []
    assert plans.kinds(check(plan)) == {"goal_missed"}
    plan["goal"] = plans.goal("cube", (0.0, 0.0, 0.03))
    assert check(plan).valid


def test_segments_shorter_than_a_step_do_nothing(urdf):
    plan = plans.carry(urdf)
    entry = plans.segment(plan, "grasp")
    plan["segments"].append(entry | {"end": entry["start"], "contact_pose": plans.pose(1.0, 1.0, 1.0)})
    assert check(plan).valid


def test_a_mesh_is_given_by_its_points(urdf):
    plan = plans.carry(urdf)
    corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    cube = plan["scene"]["bodies"][1]
    cube |= {"shape": "mesh", "size": [0.03, 0.03, 0.03], "mesh": "somewhere.stl", "vertices": corners}
    assert check(plan).valid
    cube["size"] = [0.03, 0.033, 0.03]
    assert plans.kinds(check(plan)) == {"penetration"}


def test_an_arm_without_gripper_touches_with_its_hand(urdf):
    plan = plans.carry(urdf)
    robot = plan["robots"]["gantry"]
    robot["gripper"] = None
    del plan["trajectory"]["gripper"]["gantry"]
    # without a gripper the hand itself has to touch, and it is 1 cm above the cube
    assert {"contact_missing", "untouched_motion"} <= plans.kinds(check(plan))
