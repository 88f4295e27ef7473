"""Motions of a robot past what stands, without any object; the judge looks at each of them."""

import itertools
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import HOME, box, scene

from hmap_core.benchmark import limits
from hmap_core.exceptions import Code, InputError, MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.shapes import posed_links
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan_motion, segments
from hmap_core.planner.assembly import assemble, scene_at
from hmap_core.planner.segments.ways_out import way_out
from hmap_core.planner.transit_search import TransitSearch
from hmap_core.transforms import distance, multiply, pose
from hmap_core.types import BodyKind, Goal
from hmap_core.validation import check

DOWN = (1.0, 0.0, 0.0, 0.0)
LEFT, RIGHT = pose((0.45, 0.35, 0.25), DOWN), pose((0.45, -0.35, 0.25), DOWN)
BLOCK = pose((0.6, 0.0, 0.05))


@pytest.fixture(scope="module")
def walled():
    """An arm, and a wall in the plane in which it stands; a block that is to stay where it is."""
    wall = box("wall", (0.5, 0.02, 0.45), (0.6, 0.12, 0.225), BodyKind.FIXED)
    block = box("block", (0.05, 0.05, 0.1), BLOCK[:3])
    return scene(wall, block, goal=Goal("block", BLOCK))


def judged(scene, made):
    report = check(to_dict(assemble(scene, scene.start_state(), [made], np.zeros((0, 7)), {})))
    assert report.valid, report.violations[:3]


def tip(scene, q):
    return multiply(scene.robots["left"].base_pose, load_arm(scene.robots["left"].model).end_effector(q))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("T", [LEFT, RIGHT], ids=["past the wall", "beside it"])
def test_the_end_effector_comes_to_a_pose(walled, T, seed):
    made = plan_motion(walled, "left", T_world_ee=T, seed=seed)
    q = made.trajectory.joints["left"]
    np.testing.assert_allclose(q[0], HOME)
    moved, turned = distance(T, tip(walled, q[-1]))
    assert moved < 1e-3 and turned < 5e-3
    judged(walled, made)


def test_the_robot_comes_to_a_configuration_within_its_limits(walled):
    goal = plan_motion(walled, "left", T_world_ee=LEFT, seed=1).trajectory.joints["left"][-1]
    made = plan_motion(walled, "left", q=goal, seed=2)
    q, dt = made.trajectory.joints["left"], made.trajectory.time[1]
    np.testing.assert_allclose(q[-1], goal, atol=1e-4)
    assert (np.abs(np.diff(q, axis=0)) / dt <= walled.robots["left"].model.velocity_limits).all()
    judged(walled, made)


def test_the_same_seed_gives_the_same_motion(walled):
    first, second = (plan_motion(walled, "left", T_world_ee=LEFT, seed=4).trajectory.joints["left"] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_goal_nearer_to_something_than_is_kept_on_the_way_is_reached():
    """The fingertips end 1 mm over the block."""
    above = box("block", (0.05, 0.05, 0.1), BLOCK[:3])
    open_scene = scene(above, goal=Goal("block", BLOCK))
    lowest = load_arm(open_scene.robots["left"].model).finger_vertices(0.08)[:, 2].max()
    near = plan_motion(scene(), "left", T_world_ee=pose((0.6, 0.0, 0.101 + lowest), DOWN)).trajectory
    made = plan_motion(open_scene, "left", q=near.joints["left"][-1])
    judged(open_scene, made)


def test_limits_that_were_rounded_count_as_limits(walled):
    model = walled.robots["left"].model
    q = HOME.copy()
    q[4] = model.position_limits[1, 4] + 5e-8
    made = plan_motion(walled, "left", q=q)
    assert made.trajectory.joints["left"][-1][4] <= model.position_limits[1, 4]


def inside_the_wall(walled):
    free = scene()
    return plan_motion(free, "left", T_world_ee=pose((0.5, 0.12, 0.3), DOWN)).trajectory.joints["left"][-1]


@pytest.mark.parametrize(
    ("goal", "code", "words"),
    [
        ({}, Code.INVALID_INPUT, "give one goal"),
        ({"q": HOME, "T_world_ee": LEFT}, Code.INVALID_INPUT, "give one goal"),
        ({"q": HOME[:6]}, Code.INVALID_INPUT, "7 finite joint positions"),
        ({"q": HOME + 4.0}, Code.INVALID_INPUT, "panda_joint1 at 4.0000; allowed: -2.8"),
        ({"T_world_ee": 2.0 * LEFT}, Code.INVALID_POSE, "unit quaternion"),
        ({"q": inside_the_wall}, Code.GOAL_IN_COLLISION, "wall"),
    ],
)
def test_what_cannot_be_a_goal_is_refused(walled, goal, code, words):
    goal = {key: value(walled) if callable(value) else value for key, value in goal.items()}
    with pytest.raises(InputError, match=words) as error:
        plan_motion(walled, "left", **goal)
    assert error.value.code == code


def test_an_unknown_robot_is_named(walled):
    with pytest.raises(InputError, match="robot 'right' is unknown; the scene has left"):
        plan_motion(walled, "right", q=HOME)


def test_a_pose_beyond_the_arm_is_out_of_reach(walled):
    with pytest.raises(MotionError, match=r"\(2.000, 0.000, 0.300\)") as error:
        plan_motion(walled, "left", T_world_ee=pose((2.0, 0.0, 0.3), DOWN))
    assert error.value.code == Code.OUT_OF_REACH


def test_where_no_way_is_found_the_search_goes_on_until_the_time_is_up(walled, monkeypatch):
    tries = []

    def fails(*request):
        tries.append(request)
        raise MotionError("no way")

    monkeypatch.setattr(segments, "go", fails)
    with pytest.raises(MotionError, match="no way") as error:
        plan_motion(walled, "left", q=HOME, time_limit=0.05)
    assert error.value.code == Code.NO_MOTION
    assert len(tries) > 1
    assert all(request[-1] <= 0.05 for request in tries)


# --- limits


def beyond_reach_of_search(*request, **more):
    raise AssertionError("the optimiser alone finds the motion")


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("side", [0, 1])
def test_a_goal_on_a_limit_is_reached_by_the_optimiser_alone(monkeypatch, side, joint):
    world = scene(box("block", (0.05, 0.05, 0.1), BLOCK[:3]), goal=Goal("block", BLOCK))
    model = world.robots["left"].model
    goal = HOME.copy()
    goal[joint] = model.position_limits[side, joint]
    if segments.standing_collision(world, replace(world.start_state(), q={"left": goal}), "left"):
        pytest.skip("the arm is in itself there")
    monkeypatch.setattr(TransitSearch, "ways", beyond_reach_of_search)
    there = plan_motion(world, "left", q=goal)
    q = there.trajectory.joints["left"]
    assert (q >= model.position_limits[0]).all() and (q <= model.position_limits[1]).all()
    np.testing.assert_allclose(q[-1], goal, atol=1e-4)
    judged(world, there)
    state = world.start_state()
    state.q["left"] = goal
    back = plan_motion(world, "left", q=HOME, state=state).trajectory.joints["left"]
    assert (back >= model.position_limits[0]).all() and (back <= model.position_limits[1]).all()


def test_motions_along_limits_are_within_them_between_their_steps(walled):
    model = walled.robots["left"].model
    lower, upper = model.position_limits
    for _, motion in itertools.islice(limits.cases(walled, "left", 3), 25):
        state = walled.start_state()
        state.q["left"] = motion.start
        q = plan_motion(walled, "left", q=motion.goal, state=state, seed=1).trajectory.joints["left"]
        assert (q >= lower).all() and (q <= upper).all()


# --- overlaps at the ends


def reaching_down(depth: float):
    """A scene with a block under the hand, and a configuration with the fingertips ``depth`` (m) inside of it."""
    below = box("block", (0.15, 0.15, 0.1), BLOCK[:3])
    lowest = load_arm(scene().robots["left"].model).finger_vertices(0.08)[:, 2].max()
    near = plan_motion(scene(), "left", T_world_ee=pose((0.6, 0.0, 0.1 + lowest - depth), DOWN)).trajectory
    return scene(below, goal=Goal("block", BLOCK)), near.joints["left"][-1]


@pytest.mark.parametrize("depth", [0.0, 0.0003, 0.0006, 0.0009])
def test_a_motion_goes_into_and_out_of_overlaps_that_the_judge_allows(depth, monkeypatch):
    monkeypatch.setattr(TransitSearch, "ways", beyond_reach_of_search)
    world, q = reaching_down(depth)
    made = plan_motion(world, "left", q=q)
    np.testing.assert_allclose(made.trajectory.joints["left"][-1], q, atol=1e-4)
    judged(world, made)
    state = world.start_state()
    state.q["left"] = q
    back = plan_motion(world, "left", q=HOME, state=state)
    report = check(to_dict(assemble(scene_at(world, state), state, [back], np.zeros((0, 7)), {})))
    assert report.valid, report.violations[:3]


@pytest.mark.parametrize("depth", [-0.001, 0.0, 0.0005, 0.0008])
def test_a_pose_is_reached_in_overlaps_that_the_judge_allows(depth):
    world, q = reaching_down(depth)
    made = plan_motion(world, "left", T_world_ee=tip(world, q))
    assert distance(tip(world, q), tip(world, made.trajectory.joints["left"][-1]))[0] < 1e-3
    judged(world, made)


def test_a_pose_deeper_inside_of_something_is_out_of_reach():
    world, q = reaching_down(0.002)
    with pytest.raises(MotionError) as error:
        plan_motion(world, "left", T_world_ee=tip(world, q))
    assert error.value.code == Code.OUT_OF_REACH
    assert re.search(r"it would be [12].\d\d mm inside: left/panda_\w+finger and block", error.value.reason)


def test_deeper_overlaps_are_refused_at_once():
    world, q = reaching_down(0.0013)
    with pytest.raises(InputError, match=r"'left' is 1.\d+ mm inside at its goal: .* at most 1 mm") as error:
        plan_motion(world, "left", q=q)
    assert error.value.code == Code.GOAL_IN_COLLISION
    state = world.start_state()
    state.q["left"] = q
    with pytest.raises(InputError, match=r"'left' is 1.\d+ mm inside at its start: .* at most 1 mm") as error:
        plan_motion(world, "left", q=HOME, state=state)
    assert error.value.code == Code.START_IN_COLLISION


# --- between fingers


def grasping(depth: float, width: float, yaw: float):
    """A scene with a block between the fingers, which overlap with it by about ``depth`` (m), and where."""
    size, at, turned = (0.04, width, 0.12), (0.5, 0.1, 0.06), pose((0, 0, 0), (0, 0, np.sin(yaw / 2), np.cos(yaw / 2)))
    block = box("block", size, at)
    block = replace(block, pose=multiply(block.pose, turned))
    world = scene(block, goal=Goal("block", block.pose))
    lowest = load_arm(world.robots["left"].model).finger_vertices(0.08)[:, 2].max()
    T = multiply(pose((at[0], at[1], 0.09 + lowest)), multiply(turned, pose((0, 0, 0), DOWN)))
    state = world.start_state()
    state.gripper["left"] = width - 2.0 * depth
    return world, state, plan_motion(scene(), "left", T_world_ee=T).trajectory.joints["left"][-1]


@pytest.mark.parametrize("width", [0.03, 0.06])
@pytest.mark.parametrize("depth", [0.0, 0.0002, 0.0005, 0.0008])
def test_a_hand_goes_straight_to_what_it_overlaps_with_on_both_sides_and_away_from_it(depth, width, monkeypatch):
    """Motions that turn the hand a little overlap more: neither the optimiser nor trees find one in time."""
    monkeypatch.setattr(TransitSearch, "ways", beyond_reach_of_search)
    world, state, q = grasping(depth, width, 0.3 + depth * 1e3)
    there = plan_motion(world, "left", q=q, state=state)
    np.testing.assert_allclose(there.trajectory.joints["left"][-1], q, atol=1e-4)
    inside = state.copy()
    inside.q["left"] = q
    back = plan_motion(world, "left", q=HOME, state=inside)
    to_pose = plan_motion(world, "left", T_world_ee=tip(world, q), state=state)
    for begin, made in ((state, there), (inside, back), (state, to_pose)):
        report = check(to_dict(assemble(scene_at(world, begin), begin, [made], np.zeros((0, 7)), {})))
        assert report.valid, report.violations[:3]


def test_links_slide_out_of_what_they_touch_where_the_hand_does_not_lead():
    """The robot stands in itself: no straight move of the hand parts its forearm and its wrist."""
    world = scene(box("block", (0.05, 0.05, 0.1), BLOCK[:3]), goal=Goal("block", BLOCK))
    rng, lower_upper = np.random.default_rng(5), world.robots["left"].model.position_limits
    made = 0
    while made < 3:
        q = touching_itself(world, rng, *lower_upper)
        if q is None:
            continue
        manipulation = Manipulation(world, world.start_state(), "left", None)
        cols = manipulation.standing_collisions().arrays()
        way = way_out(manipulation, cols, q, rng)
        assert way is not None and (way[0] == q).all()
        assert path_violations(way[-1:], np.ones(1, np.int64), manipulation.model.chain, cols, 0.0)[1][0] < 0
        made += 1


def touching_itself(world, rng, lower, upper):
    """A configuration in which the robot, and nothing else, overlaps by 0.6 mm; None where there is none."""
    state = world.start_state()

    def depth(q):
        state.q["left"] = q
        return segments.standing_collision(world, state, "left", allowed=0.0)

    free, inside = (rng.uniform(lower, upper) for _ in range(2))
    if depth(free) is not None or depth(inside) is None:
        return None
    for _ in range(50):
        middle = 0.5 * (free + inside)
        hit = depth(middle)
        free, inside = (middle, inside) if hit is None or hit[1] < 6e-4 else (free, middle)
    hit = depth(free)
    return free if hit is not None and 4e-4 < hit[1] and all(name.startswith("left/") for name in hit[0]) else None


def enclosed(q: np.ndarray):
    """A scene in which walls hold the fingers at q (n,) from all sides and below, and a plate one shoulder of the hand.

    All overlap by 0.5 mm.
    """
    world = scene(box("block", (0.05, 0.05, 0.1), (0.0, 0.8, 0.05)), goal=Goal("block", BLOCK))
    state = world.start_state()
    hulls = {
        name: (vertices.min(axis=0) - radius, vertices.max(axis=0) + radius)
        for name, vertices, radius, *_ in posed_links(world.robots["left"], q, state.gripper["left"])
    }
    fingers = [hulls[name] for name in hulls if "finger" in name]
    low, high = np.min([low for low, _ in fingers], axis=0), np.max([high for _, high in fingers], axis=0)
    inside, thick, middle = 0.0005, 0.05, 0.5 * (low + high)
    plates = [box("floor", (0.3, 0.3, thick), (*middle[:2], low[2] + inside - 0.5 * thick), BodyKind.FIXED)]
    for axis, (side, end) in itertools.product(range(2), ((-1, low), (1, high))):
        size, at = np.array([0.3, 0.3, 0.03]), np.array([*middle[:2], low[2] + 0.015])
        size[axis], at[axis] = thick, end[axis] + side * (0.5 * thick - inside)
        plates.append(box(f"wall{len(plates)}", size, at, BodyKind.FIXED))

    def with_shoulder(height: float):
        shoulder = box("shoulder", (0.06, 0.04, 0.01), (middle[0], -0.365, height + 0.005), BodyKind.FIXED)
        return replace(world, bodies=world.bodies | {body.name: body for body in (*plates, shoulder)})

    state.q["left"] = q
    lower, upper = middle[2], hulls["panda_hand"][1][2] + 0.01
    for _ in range(40):
        height = 0.5 * (lower + upper)
        tried = with_shoulder(height)
        hit = segments.standing_collision(
            tried, replace(state, poses=tried.start_state().poses), "left", allowed=inside
        )
        lower, upper = (height, upper) if hit is not None and "shoulder" in hit[0] else (lower, height)
    return with_shoulder(upper)


def test_where_no_motion_leads_out_that_is_told_at_once_with_names_and_depth():
    q = plan_motion(scene(), "left", T_world_ee=pose((0.4, -0.45, 0.25), DOWN)).trajectory.joints["left"][-1]
    world = enclosed(q)
    state = world.start_state()
    state.q["left"] = q
    began = time.thread_time()
    with pytest.raises(InputError, match=r"'left' is 0.\d\d mm inside at its goal, and no motion leads out") as error:
        plan_motion(world, "left", q=q)
    assert error.value.code == Code.GOAL_IN_COLLISION
    with pytest.raises(
        InputError, match=r"inside at its start, and no motion leads out of there: left/\w+ and"
    ) as error:
        plan_motion(world, "left", q=HOME, state=state)
    assert error.value.code == Code.START_IN_COLLISION
    assert time.thread_time() - began < 8.0  # of two time limits of 10 s
