"""Every rule of the judge, broken once, and called by its name."""

import math

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.validation import Kind, check, document
from hmap_core.validation.support import SupportFinder
from hmap_core.validation.world import World


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


@pytest.fixture
def carry(urdf):
    return plans.carry(urdf)


def joints(plan: dict, robot: str = "gantry") -> list:
    return plan["trajectory"]["joints"][robot]


def turned(pose: list, degrees: float) -> list:
    """A pose turned about the vertical, in place, from upright."""
    half = math.radians(degrees) / 2
    return [*pose[:3], 0.0, 0.0, math.sin(half), math.cos(half)]


# --- joints ---


def test_joint_limit(carry):
    carry["robots"]["gantry"]["position_limits"][1][0] = 0.15
    found = plans.worst(check(carry), Kind.JOINT_LIMIT)
    assert found.bodies == ("gantry", "x")
    assert (found.amount, found.limit) == (pytest.approx(0.2), 0.15)


def test_joint_limit_of_a_finger(carry):
    carry["trajectory"]["gripper"]["gantry"] = [o + 0.01 for o in carry["trajectory"]["gripper"]["gantry"]]
    assert plans.worst(check(carry), Kind.JOINT_LIMIT).bodies[1].startswith("finger_")


def test_velocity_limit(carry):
    carry["robots"]["gantry"]["velocity_limits"][0] = 0.4  # the quintic's peak is 1.875 * 0.2 / 0.8 m/s
    report = check(carry)
    assert plans.kinds(report) == {"velocity_limit"}
    assert plans.worst(report, Kind.VELOCITY_LIMIT).amount == pytest.approx(0.469, abs=2e-3)


def test_acceleration_limit(carry):
    carry["robots"]["gantry"]["acceleration_limits"][0] = 1.7  # the quintic's peak is 5.77 * 0.2 / 0.8^2 m/s^2
    report = check(carry)
    assert plans.kinds(report) == {"acceleration_limit"}
    assert plans.worst(report, Kind.ACCELERATION_LIMIT).amount == pytest.approx(1.80, abs=0.02)


@pytest.mark.parametrize("end", [0, -1])
def test_not_at_rest(carry, end):
    inward = 1 if end == 0 else -1
    path = joints(carry)
    for i in range(12):  # 0.4 m/s where the plan should stand still, gone before the hand is at anything
        path[end + inward * i][2] = path[end][2] - 0.4 * plans.DT * i * (i < 10) - 0.072 * (i >= 10)
    found = plans.worst(check(carry), Kind.NOT_AT_REST)
    assert found.bodies == ("gantry", "z")
    assert found.amount == pytest.approx(0.4, rel=1e-3)
    assert found.time == carry["trajectory"]["time"][end]


def test_jump_of_a_joint(carry):
    k = plans.sample(carry, 0.5)
    for q in joints(carry)[: k + 1]:
        q[1] -= 0.3
    carry["robots"]["gantry"]["q_start"][1] -= 0.3
    found = plans.worst(check(carry), Kind.JUMP)
    assert found.bodies == ("gantry", "y")
    assert found.time == pytest.approx(0.5)


def test_jump_of_an_object(carry):
    k = plans.sample(carry, 1.8)
    for pose in carry["trajectory"]["objects"]["cube"][k:]:
        pose[1] += 0.05
    found = plans.worst(check(carry), Kind.JUMP)
    assert found.bodies == ("cube",)
    assert found.limit == pytest.approx(0.04)


def test_jump_of_an_object_by_rotation(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    for k in range(plans.sample(carry, 1.8), len(poses)):
        poses[k] = turned(poses[k], 90.0)
    assert plans.worst(check(carry), Kind.JUMP).bodies == ("cube",)


# --- start and goal ---


def test_wrong_start_of_a_robot(carry):
    carry["robots"]["gantry"]["q_start"][2] += 0.01
    report = check(carry)
    assert plans.kinds(report) == {"start_mismatch"}
    assert plans.worst(report, Kind.START_MISMATCH).bodies == ("gantry", "z")


@pytest.mark.parametrize("change", [lambda p: [p[0] + 0.001, *p[1:]], lambda p: turned(p, 0.1)])
def test_wrong_start_of_an_object(carry, change):
    cube = carry["scene"]["bodies"][1]
    cube["pose"] = change(cube["pose"])
    assert plans.worst(check(carry), Kind.START_MISMATCH).bodies == ("cube",)


def test_goal_missed(carry):
    carry["goal"]["pose"][1] += 0.006
    report = check(carry)
    assert plans.kinds(report) == {"goal_missed"}
    assert report.goal_error["position_m"] == pytest.approx(0.006)


def test_goal_missed_by_rotation(carry):
    carry["goal"]["pose"] = turned(carry["goal"]["pose"], 3.0)
    report = check(carry)
    assert plans.kinds(report) == {"goal_missed"}
    assert plans.worst(report, Kind.GOAL_MISSED).amount == pytest.approx(3.0, abs=1e-6)


# --- penetration ---


def fast_flight(urdf, extra=(), others=None) -> dict:
    """The gantry dashes 1 m along x, 37 mm a step at its fastest, and leaves the cube alone."""
    bodies = [plans.table(), plans.box("cube", (0.06,) * 3, (0.0, 0.5, 0.03)), *extra]
    board = plans.Storyboard((-0.5, 0.0, 0.3), 0.0, bodies)
    board.move("transit", (0.5, 0.0, 0.3), 1.0)
    return board.plan(urdf, plans.goal("cube", (0.0, 0.5, 0.03)), others=others)


def test_wall_crossed_strictly_between_two_samples(urdf):
    x = np.array(joints(fast_flight(urdf)))[:, 0]
    k = int(np.argmax(np.diff(x)))
    middle = (x[k] + x[k + 1]) / 2
    # only the fingers (2 cm deep, 2.9 cm high) reach down to the wall, a sheet 4 mm thick
    wall = plans.box("wall", (0.004, 0.5, 0.1), (middle, 0.0, 0.25), "fixed")
    gap = np.abs(x - middle) - 0.01 - 0.002
    assert gap.min() > 0.005  # clear at every sample
    report = check(fast_flight(urdf, extra=(wall,)))
    assert plans.kinds(report) == {"penetration"}
    found = plans.worst(report, Kind.PENETRATION)
    assert "wall" in found.bodies
    assert x[k] < np.interp(found.time, plans.DT * np.arange(len(x)), x) < x[k + 1]
    assert found.amount > 0.008


def test_the_same_flight_over_a_lower_wall_is_fine(urdf):
    wall = plans.box("wall", (0.004, 0.5, 0.1), (0.0, 0.0, 0.2), "fixed")
    report = check(fast_flight(urdf, extra=(wall,)))
    assert report.valid
    assert report.min_clearance_m == pytest.approx(0.04, abs=1e-6)


def test_penetration_of_a_carried_object(urdf):
    block = plans.box("block", (0.02, 0.02, 0.075), (0.1, 0.0, 0.0375), "fixed")  # 5 mm higher than the cube flies
    found = plans.worst(check(plans.carry(urdf, extra=(block,))), Kind.PENETRATION)
    assert set(found.bodies) == {"cube", "block"}
    assert found.amount == pytest.approx(0.005, abs=1e-6)


@pytest.mark.parametrize(("depth", "valid"), [(0.0009, True), (0.0011, False)])
def test_penetration_limit_is_one_millimetre(urdf, depth, valid):
    """The fingers of an empty hand pass through a block; a held body would be head-on."""
    block = plans.box("block", (0.02, 0.02, 0.29 + depth), (0.0, 0.0, 0.145 + depth / 2), "fixed")
    assert check(fast_flight(urdf, extra=(block,))).valid is valid


def test_start_inside_a_wall(urdf):
    wall = plans.box("wall", (0.02, 0.1, 0.1), (0.0, 0.525, 0.05), "fixed")
    found = plans.worst(check(fast_flight(urdf, extra=(wall,))), Kind.PENETRATION)
    assert set(found.bodies) == {"cube", "wall"}
    assert found.time == 0.0


def test_self_collision(urdf):
    bodies = [plans.table(), plans.box("cube", (0.06,) * 3, (0.0, -0.5, 0.03))]
    board = plans.Storyboard((0.3, 0.6, 0.3), 0.0, bodies)
    board.move("transit", (0.56, 0.6, 0.3), 1.0)  # the fingers run into the gantry's own post at x = 0.55
    found = plans.worst(check(board.plan(urdf, plans.goal("cube", (0.0, -0.5, 0.03)))), Kind.PENETRATION)
    assert found.bodies[0].startswith("gantry/") and found.bodies[1].startswith("gantry/")


def test_robot_robot_collision(urdf):
    report = check(fast_flight(urdf, others={"other": (0.4, 0.0, 0.35)}))
    robots = {body.split("/")[0] for body in plans.worst(report, Kind.PENETRATION).bodies}
    assert robots == {"gantry", "other"}


def test_robots_that_stay_apart_are_fine(urdf):
    plan = fast_flight(urdf, others={"other": (0.4, -0.3, 0.35)})
    plan["robots"]["other"]["base_pose"] = plans.pose(0.0, -0.5, 0.0)
    plan["robots"]["other"]["q_start"] = [0.4, 0.2, 0.35]
    plan["trajectory"]["joints"]["other"] = [[0.4, 0.2, 0.35]] * len(plan["trajectory"]["time"])
    assert check(plan).valid


def test_fingers_inside_the_object(urdf):
    plan = plans.touch(urdf)
    for q in joints(plan):  # everything 3 mm lower
        q[2] -= 0.003
    plan["robots"]["gantry"]["q_start"][2] -= 0.003
    for entry in plan["segments"]:
        if entry["contact_pose"]:
            entry["contact_pose"][2] -= 0.003
    report = check(plan)
    assert plans.kinds(report) == {"penetration"}
    found = plans.worst(report, Kind.PENETRATION)
    assert "cube" in found.bodies and found.amount == pytest.approx(0.003, abs=1e-6)


def test_gripper_closed_into_the_object(carry):
    openings = carry["trajectory"]["gripper"]["gantry"]
    carry["trajectory"]["gripper"]["gantry"] = [o - 0.006 if o < 0.0601 else o for o in openings]
    assert "penetration" in plans.kinds(check(carry))


# --- contacts ---


def test_object_moves_untouched(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    first = plans.sample(carry, 4.0)
    for k in range(first, len(poses)):
        poses[k][1] += 0.001 * min(1.0, (k - first) / 20)
    report = check(carry)
    assert plans.kinds(report) == {"untouched_motion"}
    assert plans.worst(report, Kind.UNTOUCHED_MOTION).amount == pytest.approx(0.001, abs=1e-6)


def test_slow_drift_of_an_untouched_object_adds_up(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    first = plans.sample(carry, 3.8)
    for k in range(first, len(poses)):  # 4 micrometres a step
        poses[k][1] += 4e-6 * (k - first)
    assert "untouched_motion" in plans.kinds(check(carry))


def test_untouched_rotation(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    first = plans.sample(carry, 4.0)
    for k in range(first, len(poses)):
        poses[k] = turned(poses[k], 0.5 * min(1.0, (k - first) / 20))
    assert "untouched_motion" in plans.kinds(check(carry))


def test_a_fixed_body_that_moves(urdf):
    block = plans.box("block", (0.05, 0.05, 0.05), (0.5, -0.5, 0.5), "fixed")
    plan = plans.carry(urdf, extra=(block,))
    N = len(plan["trajectory"]["time"])
    plan["trajectory"]["objects"]["block"] = [plans.pose(0.5, -0.5, 0.5 + 0.0002 * k) for k in range(N)]
    report = check(plan)
    assert plans.kinds(report) == {"untouched_motion"}
    assert plans.worst(report, Kind.UNTOUCHED_MOTION).bodies == ("block",)


def test_motion_in_a_segment_whose_fingers_are_away(carry):
    carry["trajectory"]["gripper"]["gantry"] = [plans.OPEN] * len(carry["trajectory"]["time"])
    found = plans.kinds(check(carry))
    assert {"untouched_motion", "contact_missing"} <= found


def test_contact_missing_on_one_finger_of_a_grasp(carry):
    shift = 0.004  # the hand off the cube's middle, and the gripper 8 mm wider: one finger touches
    for q in joints(carry):
        q[1] += shift
    carry["robots"]["gantry"]["q_start"][1] += shift
    carry["trajectory"]["gripper"]["gantry"] = [max(o, 0.068) for o in carry["trajectory"]["gripper"]["gantry"]]
    for entry in carry["segments"]:
        if entry["contact_pose"]:
            entry["contact_pose"][1] += shift
    found = plans.worst(check(carry), Kind.CONTACT_MISSING)
    assert found.amount == pytest.approx(0.008, abs=1e-6)


def test_contact_missing_for_a_touch(urdf):
    plan = plans.touch(urdf)
    for q in joints(plan):
        q[2] += 0.002
    plan["robots"]["gantry"]["q_start"][2] += 0.002
    for entry in plan["segments"]:
        if entry["contact_pose"]:
            entry["contact_pose"][2] += 0.002
    found = plans.worst(check(plan), Kind.CONTACT_MISSING)
    assert found.amount == pytest.approx(0.002, abs=1e-6)
    assert found.bodies == ("gantry/hand", "cube")


def test_wrong_contact_pose(carry):
    for entry in carry["segments"]:
        if entry["contact_pose"]:
            entry["contact_pose"][0] += 0.002
    report = check(carry)
    assert plans.kinds(report) == {"wrong_contact_pose"}
    assert plans.worst(report, Kind.WRONG_CONTACT_POSE).amount == pytest.approx(0.002)


def test_slipping_contact(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    first, last = plans.sample(carry, 2.1), plans.sample(carry, 2.7)
    for k in range(first, len(poses)):  # falls back by 3 mm along the fingers while it is carried
        poses[k][0] -= 0.003 * min(1.0, (k - first) / (last - first))
    report = check(carry)
    assert "slip" in plans.kinds(report)
    found = plans.worst(report, Kind.SLIP)
    assert found.bodies == ("gantry/hand", "cube")
    assert found.amount == pytest.approx(0.003, abs=1e-6)


def test_slip_by_rotation(carry):
    poses = carry["trajectory"]["objects"]["cube"]
    first, last = plans.sample(carry, 2.1), plans.sample(carry, 2.7)
    for k in range(first, len(poses)):
        poses[k] = turned(poses[k], 0.7 * min(1.0, (k - first) / (last - first)))
    found = plans.worst(check(carry), Kind.SLIP)
    assert (found.amount, found.limit) == (pytest.approx(0.7, abs=1e-3), pytest.approx(0.5))


def test_slip_that_creeps_through_many_segments(carry):
    """Each of ten segments slips by 0.5 mm and says so in its contact pose: together they are 5 mm."""
    entry = next(s for s in carry["segments"] if s["kind"] == "grasp" and s["start"] == pytest.approx(2.0))
    poses, hand = carry["trajectory"]["objects"]["cube"], joints(carry)
    first, last = plans.sample(carry, entry["start"]), plans.sample(carry, entry["end"])
    for k in range(first, len(poses)):
        poses[k][0] -= 0.005 * min(1.0, (k - first) / (last - first))
    carry["segments"].remove(entry)
    for i in range(10):
        begin, end = first + 4 * i, first + 4 * (i + 1)
        contact = plans.pose(*(np.array(hand[begin]) - poses[begin][:3]))
        times = {"start": begin * plans.DT, "end": end * plans.DT}
        carry["segments"].append(entry | times | {"contact_pose": contact})
    for entry in carry["segments"]:
        if entry["contact_pose"] and entry["start"] > 2.79:
            entry["contact_pose"][0] += 0.005
    carry["goal"]["pose"][0] -= 0.005
    report = check(carry)
    assert plans.kinds(report) == {"slip"}
    assert plans.worst(report, Kind.SLIP).amount == pytest.approx(0.005, abs=1e-6)


def test_slip_of_a_held_tool(urdf):
    plan = plans.tool_use(urdf)
    entry = plans.segment(plan, "touch")
    first, last = plans.sample(plan, entry["start"]), plans.sample(plan, entry["end"])
    for name in ("stick", "cube"):  # the tool and what it carries lag behind the hand together
        for k in range(first, len(plan["trajectory"]["time"])):
            plan["trajectory"]["objects"][name][k][0] += 0.002 * min(1.0, (k - first) / (last - first))
    assert plans.worst(check(plan), Kind.SLIP).bodies == ("gantry/hand", "stick")


def test_grasp_not_opposed(urdf):
    # both fingertips stand on the cube's top: near enough, but pressing from the same side
    plan = plans.touch(urdf)
    plan["trajectory"]["gripper"]["gantry"] = [0.02] * len(plan["trajectory"]["time"])
    for entry in plan["segments"]:
        entry["kind"] = "grasp" if entry["kind"] == "touch" else entry["kind"]
    report = check(plan)
    assert plans.kinds(report) == {"grasp_not_opposed"}
    assert plans.worst(report, Kind.GRASP_NOT_OPPOSED).amount == pytest.approx(180.0, abs=0.1)


# --- support ---


def drop_at(urdf, at, extra=()) -> dict:
    """The cube is grasped, and let go with its centre at a place."""
    bodies = [plans.table(), plans.box("cube", (0.06,) * 3, (0.0, 0.0, 0.03)), *extra]
    board = plans.Storyboard((0.0, 0.0, 0.3), plans.OPEN, bodies)
    board.move("transit", (0.0, 0.0, 0.03), 1.0)
    board.move("transit", (0.0, 0.0, 0.03), 0.4, opening=0.06)
    board.move("grasp", (0.0, 0.0, 0.2), 0.8, carries=("cube",))
    board.move("grasp", (at[0], at[1], 0.2), 1.2, carries=("cube",))
    board.move("grasp", at, 0.8, carries=("cube",))
    board.move("transit", at, 0.4, opening=plans.OPEN)
    board.move("transit", (at[0], at[1], 0.3), 1.0)
    return board.plan(urdf, plans.goal("cube", at))


def test_floating_object(urdf):
    found = plans.worst(check(drop_at(urdf, (0.2, 0.0, 0.05))), Kind.UNSUPPORTED)
    assert found.bodies == ("cube",)
    assert found.amount == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize(("over", "valid"), [(-0.005, True), (0.005, False)])
def test_object_over_an_edge(urdf, over, valid):
    shelf = plans.box("shelf", (0.2, 0.2, 0.08), (0.4, 0.0, 0.04), "fixed")
    report = check(drop_at(urdf, (0.3 - over, 0.0, 0.11), extra=(shelf,)))
    assert report.valid is valid
    if not valid:
        assert set(plans.worst(report, Kind.UNSUPPORTED).bodies) == {"cube", "shelf"}


def test_object_bridging_two_supports(urdf):
    rails = [plans.box(f"rail{i}", (0.01, 0.2, 0.05), (x, 0.0, 0.025), "fixed") for i, x in enumerate((0.28, 0.32))]
    assert check(drop_at(urdf, (0.3, 0.0, 0.08), extra=rails)).valid


def test_object_clamped_between_two_walls_is_not_carried_by_them(urdf):
    # each reaches 0.15 mm into the cube, which hangs between them
    walls = [plans.box(f"wall{x}", (0.02, 0.1, 0.1), (x, 0.0, 0.05), "fixed") for x in (0.26015, 0.33985)]
    assert plans.kinds(check(drop_at(urdf, (0.3, 0.0, 0.06), extra=walls))) == {"unsupported"}


def test_support_taken_away(urdf):
    bodies = [
        plans.table(),
        plans.box("low", (0.06,) * 3, (0.0, 0.0, 0.03)),
        plans.box("high", (0.06,) * 3, (0.0, 0.0, 0.09)),
    ]
    board = plans.Storyboard((-0.04, 0.0, 0.3), 0.0, bodies)
    board.move("transit", (-0.3, 0.0, 0.3), 1.0)
    board.move("transit", (-0.3, 0.0, 0.03), 1.0)
    board.move("transit", (-0.04, 0.0, 0.03), 1.0)
    board.move("touch", (0.2, 0.0, 0.03), 1.0, carries=("low",))
    found = plans.worst(check(board.plan(urdf, plans.goal("low", (0.24, 0.0, 0.03)))), Kind.UNSUPPORTED)
    assert found.bodies == ("high",)
    assert found.time == pytest.approx(4.0)


def released(urdf, shape: str, size, T, extra=(), mode: str = "physical") -> dict:
    """The cube of :func:`drop_at`, replaced by another body that is let go at a pose."""
    plan = drop_at(urdf, tuple(T[:3]), extra)
    plan["mode"] = mode
    body = next(entry for entry in plan["scene"]["bodies"] if entry["name"] == "cube")
    body |= {"shape": shape, "size": list(size)}
    plan["goal"]["pose"] = list(T)
    for k, at in enumerate(plan["trajectory"]["objects"]["cube"]):
        plan["trajectory"]["objects"]["cube"][k] = [*at[:3], *T[3:]]
    body["pose"] = plan["trajectory"]["objects"]["cube"][0]
    return plan


def unsupported(plan: dict) -> bool:
    """Whether the judge says that the body is not supported at the end; contacts with it are not looked at."""
    world = World(document.read(plan))
    return not SupportFinder(world).at("cube", world.samples - 1, plan["mode"] == "physical").stable


def ring(at, gap: float) -> list[dict]:
    span, (x, y) = 2 * (0.03 + gap) + 0.008, at
    places = [(x, y + span / 2), (x, y - span / 2), (x + span / 2, y), (x - span / 2, y)]
    sizes = [(span, 0.008, 0.012)] * 2 + [(0.008, span, 0.012)] * 2
    return [
        plans.box(f"wall{k}", size, (*place, 0.006), "fixed")
        for k, (place, size) in enumerate(zip(places, sizes, strict=True))
    ]


@pytest.mark.parametrize(("gap", "mode", "falls"), [(None, "physical", True), (0.006, "physical", False)])
def test_a_released_ball_rolls_away_unless_a_ring_stops_it(urdf, gap, mode, falls):
    extra = () if gap is None else ring((0.3, 0.0), gap)
    plan = released(urdf, "sphere", (0.03,), plans.pose(0.3, 0.0, 0.03), extra, mode)
    assert unsupported(plan) is falls


def test_a_released_rod_rolls_away_unless_it_lies_between_rails(urdf):
    lying = [0.0, math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4)]
    rails = [plans.box(f"rail{y}", (0.3, 0.01, 0.02), (0.3, y, 0.01), "fixed") for y in (-0.015, 0.015)]
    height = 0.02 + math.sqrt(0.02**2 - 0.01**2)
    assert unsupported(released(urdf, "cylinder", (0.02, 0.1), [0.3, 0.0, 0.02, *lying]))
    assert not unsupported(released(urdf, "cylinder", (0.02, 0.1), [0.3, 0.0, height, *lying], rails))


@pytest.mark.parametrize(("friction", "falls"), [(0.6, False), (0.05, True)])
def test_a_board_leans_against_a_wall_if_friction_keeps_it(urdf, friction, falls):
    angle = math.radians(20.0)
    turn = [0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]
    half = np.array([0.005, 0.1])  # of its extents along x and z
    wide, high = half @ [math.cos(angle), math.sin(angle)], half @ [math.sin(angle), math.cos(angle)]
    wall = plans.box("wall", (0.02, 1.0, 0.5), (0.31 + wide, 0.0, 0.25), "fixed", friction)
    plan = released(urdf, "box", (0.01, 0.05, 0.2), [0.3, 0.0, high, *turn], (wall,))
    for body in plan["scene"]["bodies"]:
        body["friction"] = friction
    assert unsupported(plan) is falls


def test_push_over_the_edge_of_the_table(urdf):
    found = plans.worst(check(plans.push(urdf, to=(0.2, 0.0), table_end=0.15)), Kind.UNSUPPORTED)
    assert "cube" in found.bodies
    assert check(plans.push(urdf, to=(0.1, 0.0), table_end=0.15)).valid


# --- physics ---


def test_one_sided_touch_is_not_physical(urdf):
    plan = plans.touch(urdf)
    plan["mode"] = "physical"
    assert plans.kinds(check(plan)) == {"not_physical"}


def test_grasp_width(carry):
    carry["robots"]["gantry"]["gripper"]["max_opening"] = 0.055
    report = check(carry)
    assert plans.kinds(report) == {"grasp_width"}
    found = plans.worst(report, Kind.GRASP_WIDTH)
    assert (found.amount, found.limit) == (pytest.approx(0.06), 0.055)


@pytest.mark.parametrize(
    ("to", "friction", "valid"),
    [
        ((0.1, 0.0), 0.5, True),  # straight ahead
        ((0.1, 0.03), 0.5, True),  # 17 degrees aside, cone of 27
        ((0.1, 0.03), 0.1, False),  # the same on ice
        ((0.05, 0.1), 0.5, False),  # 63 degrees aside
        ((-0.1, 0.0), 0.5, False),  # a push cannot pull
    ],
)
def test_friction_cone(urdf, to, friction, valid):
    report = check(plans.push(urdf, to=to, friction=friction))
    assert report.valid is valid
    if not valid:
        assert plans.kinds(report) == {"friction_cone"}


def test_pushing_round_an_arc(tmp_path):
    assert check(plans.arc_push(tmp_path, 0.5)).valid


def test_pushing_round_a_tight_arc_needs_a_torque(tmp_path):
    assert check(plans.arc_push(tmp_path, 0.12, aside=-0.03)).valid  # pushed beyond its centre it turns inwards
    assert plans.kinds(check(plans.arc_push(tmp_path, 0.12, aside=0.005))) == {"friction_cone"}


def test_pushing_beside_the_centre_of_mass_turns_the_object(tmp_path):
    # the force has to pass within reach of the centre: 2 cm beside it is too far, for the same motion
    assert plans.kinds(check(plans.arc_push(tmp_path, 0.5, aside=0.02))) == {"friction_cone"}


def test_what_hangs_over_the_support_has_no_friction_with_it(tmp_path):
    plan = plans.arc_push(tmp_path, 0.12, aside=-0.03)
    cube = plan["scene"]["bodies"][1]
    block = {"shape": "box", "size": cube.pop("size"), "pose": plans.pose(0.0, 0.0, 0.0)}
    lid = {"shape": "box", "size": [0.3, 0.3, 0.002], "pose": plans.pose(0.0, 0.0, plans.SIDE)}
    cube |= {"shape": "compound", "parts": [block, lid]}
    assert check(plan).valid


def test_contact_that_holds_only_at_the_samples(tmp_path):
    """Coarse samples of an arc: between them the cube goes straight while the paw goes round."""
    report = check(plans.arc_push(tmp_path, 0.5, dt=0.2))
    found = plans.worst(report, Kind.SLIP)
    assert found.time / 0.2 % 1.0 == pytest.approx(0.5)


def test_every_kind_is_named_here():
    names = ("rejects", "loads", "blind_spots", "shared", "presses", "turning", "head_on")
    files = [__file__.replace("rejects", name) for name in names]
    text = "".join(open(file).read() for file in files)
    missing = [kind.name for kind in Kind if f"Kind.{kind.name}" not in text and f'"{kind}"' not in text]
    assert not missing
