"""Plans that look right and would fail on a robot; each was once accepted, and is now rejected by its name."""

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.exceptions import InputError
from hmap_core.validation import Kind, check


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


def cube_of(plan: dict) -> dict:
    return next(body for body in plan["scene"]["bodies"] if body["name"] == "cube")


def able(plan: dict) -> dict:
    """The plan with a robot whose file says what it is able to."""
    robot = plan["robots"]["gantry"]
    robot["payload"] = 3.0
    robot["gripper"] |= {"force": 40.0, "speed": 0.2}
    return plan


def drag(urdf: str, kind: str) -> dict:
    """The cube slides along the table between the fingers, in a contact that is called as given."""
    bodies = [plans.table(), plans.box("cube", (plans.SIDE,) * 3, (0.0, 0.0, plans.SIDE / 2))]
    board = plans.Storyboard((0.0, 0.0, plans.ABOVE), plans.OPEN, bodies)
    board.move("transit", (0.0, 0.0, plans.GRASP_Z), 1.0)
    board.move("transit", (0.0, 0.0, plans.GRASP_Z), 0.4, opening=plans.SIDE)
    board.move(kind, (0.2, 0.0, plans.GRASP_Z), 1.0, carries=("cube",))
    board.move("transit", (0.2, 0.0, plans.GRASP_Z), 0.4, opening=plans.OPEN)
    board.move("transit", (0.2, 0.0, plans.ABOVE), 1.0)
    return board.plan(urdf, plans.goal("cube", (0.2, 0.0, plans.SIDE / 2)), "physical")


def pushed(urdf: str, height: float, depth: float, friction: float) -> dict:
    """A block of some height, and depth (m) along the push, is pushed from 4 cm below its upper edge on."""
    bodies = [plans.table(), plans.box("cube", (depth, plans.SIDE, height), (0.0, 0.0, height / 2))]
    for body in bodies:
        body["friction"] = friction
    behind, z = -depth / 2 - 0.01, height - 0.04 + plans.TIP
    board = plans.Storyboard((behind, 0.0, 0.6), 0.0, bodies)
    board.move("transit", (behind, 0.0, z), 1.0)
    board.move("push", (behind + 0.1, 0.0, z), 1.0, carries=("cube",))
    board.move("transit", (behind + 0.1, 0.0, 0.6), 1.0)
    return board.plan(urdf, plans.goal("cube", (0.1, 0.0, height / 2)), "physical")


def held_by(urdf: str, overlap: float) -> dict:
    """The cube is carried by pads that reach over its upper edge by a distance (m)."""
    plan = plans.carry(urdf)
    shift = plans.SIDE + plans.TIP - overlap - plans.GRASP_Z
    for q in plan["trajectory"]["joints"]["gantry"]:
        q[2] += shift
    plan["robots"]["gantry"]["q_start"][2] += shift
    for entry in plan["segments"]:
        if entry["contact_pose"]:
            entry["contact_pose"][2] += shift
    return plan


def through(urdf: str, seconds: float) -> dict:
    """The fingers come along the table, meet the cube and push it on; with a stop at the cube, or without."""
    bodies = [plans.table(), plans.box("cube", (plans.SIDE,) * 3, (0.0, 0.0, plans.SIDE / 2))]
    meets, z = -plans.SIDE / 2 - 0.01, plans.GRASP_Z
    board = plans.Storyboard((meets - 0.1, 0.0, z), 0.0, bodies)
    board.move("transit", (meets, 0.0, z), seconds)
    board.move("push", (meets + 0.1, 0.0, z), seconds, carries=("cube",))
    return board.plan(urdf, plans.goal("cube", (0.1, 0.0, plans.SIDE / 2)), "physical")


def test_what_a_robot_is_able_to_is_accepted(urdf):
    assert check(able(plans.carry(urdf))).violations == ()


def test_a_heavy_object_in_a_lifted_grasp(urdf):
    plan = able(plans.carry(urdf))
    cube_of(plan)["mass"] = 40.0
    assert plans.kinds(check(plan)) == {Kind.GRIP_FORCE, Kind.PAYLOAD}


def test_a_slippery_object_in_a_lifted_grasp(urdf):
    plan = able(plans.carry(urdf))
    cube_of(plan)["friction"] = 0.02
    assert plans.kinds(check(plan)) == {Kind.GRIP_FORCE}


def test_a_heavy_object_that_is_dragged(urdf):
    plan = able(drag(urdf, "grasp"))
    assert check(plan).valid
    cube_of(plan)["mass"] = 40.0
    report = check(plan)
    assert plans.kinds(report) == {Kind.PAYLOAD}
    assert plans.worst(report, Kind.PAYLOAD).amount == pytest.approx(20.0)  # friction 0.5


@pytest.mark.parametrize(
    ("height", "depth", "friction", "valid"),
    [
        (0.06, 0.06, 0.5, True),
        (0.24, 0.06, 0.5, False),  # a tower
        (0.24, 0.06, 0.1, True),  # the same on ice
        (0.24, 0.3, 0.5, True),  # a wall, along its length
    ],
)
def test_a_push_that_topples_its_object(urdf, height, depth, friction, valid):
    report = check(pushed(urdf, height, depth, friction))
    assert report.valid is valid
    if not valid:
        assert plans.kinds(report) == {Kind.PUSH_TOPPLES}
        found = plans.worst(report, Kind.PUSH_TOPPLES)
        assert found.amount == friction and 0.1 < found.limit < 0.25  # slides up to about 3 cm / 20 cm


def test_a_grasp_that_is_called_a_push(urdf):
    assert check(drag(urdf, "grasp")).valid
    report = check(drag(urdf, "push"))
    assert Kind.PUSH_NOT_ONE_SIDED in plans.kinds(report)
    assert plans.worst(report, Kind.PUSH_NOT_ONE_SIDED).amount == pytest.approx(180.0, abs=0.1)


def test_a_body_that_may_not_be_moved(urdf):
    plan = plans.carry(urdf, extra=(plans.box("other", (0.05,) * 3, (0.5, 0.5, 0.025)),))
    plan["goal"] = plans.goal("other", (0.5, 0.5, 0.025))
    assert check(plan).valid  # the file does not say
    for removable in ({"cube": None}, ["cube"]):
        plan["scene"]["removable"] = removable
        assert check(plan).valid
    plan["scene"]["removable"] = {}
    report = check(plan)
    assert plans.kinds(report) == {Kind.NOT_REMOVABLE}
    assert plans.worst(report, Kind.NOT_REMOVABLE).bodies == ("cube",)


def test_a_removable_body_that_is_not_there_is_refused(urdf):
    plan = plans.carry(urdf)
    plan["scene"]["removable"] = {"cubes": None}
    with pytest.raises(InputError, match="removable.*'cubes' is no body"):
        check(plan)


def test_tools_and_the_goals_object_need_no_permission(urdf):
    plan = plans.tool_use(urdf)
    plan["scene"]["removable"] = {}
    assert check(plan).valid


def test_a_gripper_that_is_faster_than_its_file_says(urdf):
    plan = able(plans.carry(urdf))
    plan["robots"]["gantry"]["gripper"]["speed"] = 0.05
    report = check(plan)
    assert plans.kinds(report) == {Kind.VELOCITY_LIMIT}
    found = plans.worst(report, Kind.VELOCITY_LIMIT)
    assert found.bodies == ("gantry", "gripper")
    assert found.amount == pytest.approx(1.875 * 0.02 / 0.4, rel=0.02) and found.limit == 0.05


def test_an_arm_that_moves_across_a_mode_switch(urdf):
    plan = through(urdf, 0.3)
    assert check(plan).valid
    q, cube = plan["trajectory"]["joints"]["gantry"], plan["trajectory"]["objects"]["cube"]
    u = np.linspace(0.0, 1.0, len(q))
    begin = q[0][0]
    for k, x in enumerate(begin + 0.2 * (10 * u**3 - 15 * u**4 + 6 * u**5)):  # half of the way at half of the time
        q[k][0] = x
        cube[k][0] = max(0.0, x - begin - 0.1)
    report = check(plan)
    assert plans.kinds(report) == {Kind.NOT_AT_REST}
    found = plans.worst(report, Kind.NOT_AT_REST)
    assert (found.bodies, found.time) == (("gantry", "x"), pytest.approx(0.3))
    assert found.amount == pytest.approx(0.2 * 1.875 / 0.6, rel=0.02)


def test_one_contact_in_several_segments_does_not_rest_between_them(urdf):
    plan = plans.carry(urdf)
    entry = plans.segment(plan, "grasp")
    middle = plans.DT * round((entry["start"] + entry["end"]) / 2 / plans.DT)
    plan["segments"].append(entry | {"start": middle})
    entry["end"] = middle
    assert check(plan).valid


def test_a_robot_file_that_allows_more_than_its_urdf(urdf):
    bodies = [plans.table(), plans.box("cube", (plans.SIDE,) * 3, (0.0, 0.5, plans.SIDE / 2))]
    board = plans.Storyboard((-0.5, 0.0, 0.3), 0.0, bodies)
    board.move("transit", (0.5, 0.0, 0.3), 0.5)
    plan = board.plan(urdf, plans.goal("cube", (0.0, 0.5, plans.SIDE / 2)))
    plan["robots"]["gantry"] |= {"velocity_limits": [100.0] * 3, "acceleration_limits": [1000.0] * 3}
    report = check(plan)
    assert plans.kinds(report) == {Kind.VELOCITY_LIMIT}
    assert plans.worst(report, Kind.VELOCITY_LIMIT).limit == plans.VELOCITY


@pytest.mark.parametrize(("overlap", "valid"), [(0.0003, False), (0.003, True), (0.02, True)])
def test_pads_that_hold_an_edge_only(urdf, overlap, valid):
    report = check(held_by(urdf, overlap))
    assert report.valid is valid
    if not valid:
        assert plans.kinds(report) == {Kind.GRASP_AT_EDGE}
        assert plans.worst(report, Kind.GRASP_AT_EDGE).amount == pytest.approx(0.0017, abs=1e-4)


def test_a_thin_plate_across_the_pads_is_no_edge(urdf):
    plan = plans.carry(urdf)
    cube = cube_of(plan)
    cube["size"] = [0.002, plans.SIDE, plans.SIDE]
    assert Kind.GRASP_AT_EDGE not in plans.kinds(check(plan))
