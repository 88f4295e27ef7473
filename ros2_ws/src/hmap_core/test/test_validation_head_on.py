"""Held bodies that run into a face of another one are rejected, however little they overlap; those that slide not."""

import copy
import math

import numpy as np
import pytest
import validation_fixtures as plans
from replan_fixtures import brick_plan

from hmap_core.plan_file import to_dict
from hmap_core.validation import Kind, check, limits

HEIGHT = 0.07  # m, of the carried cube's underside above the table


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


@pytest.fixture(scope="module")
def brick(tmp_path_factory):
    return to_dict(brick_plan(tmp_path_factory))


def head_on(plan: dict) -> list:
    return [violation for violation in check(plan).violations if violation.kind == Kind.HEAD_ON]


def board(top: float, x: float = 0.1) -> dict:
    """A fixed board, 10 cm long, whose top is at a height and whose middle is at x."""
    return plans.box("board", (0.1, 0.1, 0.02), (x, 0.0, top - 0.01), "fixed")


def onto_board(urdf: str, height: float, overlap: float) -> dict:
    """The cube is carried at a height above a board of 9 cm, and put on it with an overlap, m."""
    top = 0.09
    bodies = [plans.table(), plans.box("cube", (plans.SIDE,) * 3, (0.0, 0.0, plans.SIDE / 2)), board(top, 0.2)]
    story = plans.Storyboard((0.0, 0.0, plans.ABOVE), plans.OPEN, bodies)
    story.move("transit", (0.0, 0.0, plans.GRASP_Z), 1.0)
    story.move("transit", (0.0, 0.0, plans.GRASP_Z), 0.4, opening=plans.SIDE)
    for at in ((0.0, 0.0, top + height), (0.2, 0.0, top + height), (0.2, 0.0, top - overlap)):
        story.move("grasp", (*at[:2], at[2] + plans.GRASP_Z), 0.8, carries=("cube",))
    end = top - overlap + plans.GRASP_Z
    story.move("transit", (0.2, 0.0, end), 0.4, opening=plans.OPEN)
    story.move("transit", (0.2, 0.0, plans.ABOVE), 1.0)
    return story.plan(urdf, plans.goal("cube", (0.2, 0.0, end)), "physical")


@pytest.mark.parametrize("overlap", [3e-4, 5e-4, 9e-4])
def test_carried_into_the_front_of_a_board(urdf, overlap):
    report = check(plans.carry(urdf, extra=(board(HEIGHT + overlap),)))
    assert plans.kinds(report) == {"head_on"}
    found = plans.worst(report, Kind.HEAD_ON)
    assert found.bodies == ("cube", "board")
    assert (found.amount, found.limit) == (pytest.approx(overlap, abs=1e-6), limits.HEAD_ON)


def test_carried_over_the_board(urdf):
    report = check(plans.carry(urdf, extra=(board(HEIGHT - 3e-4),)))
    assert report.valid
    assert report.min_held_clearance_m == pytest.approx(3e-4, abs=1e-6)


def test_a_step_of_a_tenth_of_a_millimetre_is_flush(urdf):
    assert check(plans.carry(urdf, extra=(board(HEIGHT + 1e-4),))).valid


@pytest.mark.parametrize("height", [0.005, -1e-4])
def test_put_on_a_board(urdf, height):
    """From above, or slid on and then pressed into it, by half a millimetre."""
    assert check(onto_board(urdf, height, 5e-4)).valid


def test_put_on_a_board_after_it_was_met(urdf):
    assert plans.kinds(check(onto_board(urdf, -5e-4, -5e-4))) >= {"head_on"}


def test_deeper_than_a_penetration_is_only_that(urdf):
    assert plans.kinds(check(plans.carry(urdf, extra=(board(HEIGHT + 1.1e-3),)))) == {"penetration"}


@pytest.mark.parametrize(("step", "valid"), [(1e-4, True), (-1e-4, True), (3e-4, False)])
def test_pushed_over_a_seam_of_two_tables(urdf, step, valid):
    plan = plans.push(urdf, table_end=0.06)
    second = plans.box("second", (1.0, 3.0, 0.1), (0.56, 0.0, step - 0.05), "fixed")
    plan["scene"]["bodies"].append(second)
    report = check(plan)
    assert report.valid is valid
    assert valid or plans.kinds(report) == {"head_on"}


def test_pushed_over_a_seam_while_it_is_pressed_into_both_tables(urdf):
    plan = plans.push(urdf, table_end=0.06)
    plan["scene"]["bodies"].append(plans.box("second", (1.0, 3.0, 0.1), (0.56, 0.0, -0.05), "fixed"))
    for ground in plan["scene"]["bodies"]:
        if ground["kind"] == "fixed":
            ground["pose"][2] += 4e-4
    assert check(plan).valid


@pytest.mark.parametrize(("overlap", "valid"), [(1e-4, True), (5e-4, False)])
def test_the_tip_of_a_tool_meets_the_edge_of_a_wall(urdf, overlap, valid):
    plan = plans.tool_use(urdf)
    face = -plans.SIDE / 2 + overlap
    plan["scene"]["bodies"].append(plans.box("wall", (0.02, 0.1, 0.015), (0.2, face - 0.05, 0.0075), "fixed"))
    report = check(plan)
    assert report.valid is valid
    assert valid or [violation.bodies for violation in report.violations] == [("stick", "wall")]


def test_a_pushed_body_meets_another_one(urdf):
    plan = plans.push(urdf)
    post = plans.box("post", (0.02, 0.1, 0.1), (0.08, plans.SIDE / 2 + 0.05 - 5e-4, 0.05), "fixed")
    plan["scene"]["bodies"].append(post)
    assert [violation.bodies for violation in head_on(plan)] == [("cube", "post")]


def test_a_round_body_that_grazes_an_edge(urdf):
    """It passes the edge at 7 degrees from the normal's plane, and is only pressed aside."""
    post = plans.box("post", (0.02, 0.04, 0.085), (0.1, -plans.SIDE / 2 - 0.02 + 5e-4, 0.0425), "fixed")
    plan = plans.carry(urdf, extra=(post,))
    assert head_on(plan)
    cube = next(body for body in plan["scene"]["bodies"] if body["name"] == "cube")
    cube |= {"shape": "cylinder", "size": [plans.SIDE / 2, plans.SIDE]}
    assert not head_on(plan)


def test_a_body_that_tilts_over_an_edge(urdf):
    """The cube's underside keeps its contact, half a millimetre deep, with the edge that it turns about."""
    plan = plans.carry(urdf, extra=(plans.box("post", (0.1, 0.1, HEIGHT), (-0.5, -0.5, HEIGHT / 2), "fixed"),))
    edge = np.array([-0.45, -0.5, HEIGHT - 5e-4])
    poses = plan["trajectory"]["objects"]["cube"]
    first, last = plans.sample(plan, 2.0), plans.sample(plan, 2.8)
    for k in range(first, last + 1):
        s = (k - first) / (last - first)
        angle = math.radians(40.0) * s
        tilt = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
        arm = np.array([0.0, 0.0, plans.SIDE / 2 + 2e-3 * max(0.0, 1.0 - 4.0 * s)])  # comes down in the first quarter
        poses[k] = [*(edge + tilt @ arm), 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]
    assert not [violation for violation in check(plan).violations if "post" in violation.bodies]


def with_bar(plan: dict, overlap: float) -> tuple[dict, str]:
    """A plan with a thin bar across the way of the body that it carries, below the middle of the fastest step."""
    plan = copy.deepcopy(plan)
    name = plan["goal"]["object"]
    body = next(entry for entry in plan["scene"]["bodies"] if entry["name"] == name)
    poses = np.array(plan["trajectory"]["objects"][name])
    k = int(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).argmax())
    x, y, z = poses[k, :3]
    top = z - body["size"][2] / 2 + overlap
    along = poses[k + 1, :2] - poses[k, :2]
    yaw = math.atan2(along[1], along[0])
    turn = [0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]
    bar = plans.box("bar", (0.004, 0.2, 0.004), (x, y, top - 0.002), "fixed")
    plan["scene"]["bodies"].append(bar | {"pose": [x, y, top - 0.002, *turn]})
    return plan, name


@pytest.mark.parametrize(("overlap", "valid"), [(-3e-4, True), (3e-4, False), (9e-4, False)])
def test_a_plan_of_the_planner_with_a_bar_across_its_way(brick, overlap, valid):
    assert check(brick).valid
    plan, name = with_bar(brick, overlap)
    found = head_on(plan)
    assert (not found) is valid
    assert valid or [violation.bodies for violation in found] == [(name, "bar")]
