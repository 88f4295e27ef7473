"""Motions of a robot past what stands, without any object; the judge looks at each of them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import HOME, box, scene

from hmap_core.benchmark import limits
from hmap_core.exceptions import Code, InputError, MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan_motion, segments
from hmap_core.planner.assembly import assemble, scene_at
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
