"""Joints and fingers that are measured a little beyond a limit are on it; those that are far beyond are refused."""

from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import CARRY, GOAL, START, carry
from simulation_fixtures import box, scene

from hmap_core.cli import main
from hmap_core.exceptions import Code, InputError
from hmap_core.plan_file import load, to_dict
from hmap_core.planner import plan, plan_motion
from hmap_core.planner.repair import plan_anew
from hmap_core.trajectory.measured import without_noise
from hmap_core.trajectory.measured_limits import within_limits
from hmap_core.types import JOINT_TOLERANCE, OPENING_TOLERANCE
from hmap_core.validation import check

FINGER = (-0.0003, 0.0405)  # m, at which a finger joint of 0 to 0.04 m was measured; the opening is twice that


@pytest.fixture(scope="module")
def world():
    return scene(box("block", (0.05, 0.05, 0.1), (0.6, 0.0, 0.05)))


def beyond(world, side: int, joint: int, excess: float):
    """The start with one joint beyond its lower (0) or upper (1) limit."""
    state = world.start_state()
    state.q["left"][joint] = world.robots["left"].model.position_limits[side, joint] + (2 * side - 1) * excess
    return state


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("joint", range(7))
def test_a_joint_a_little_beyond_a_limit_is_on_it(world, side, joint):
    model = world.robots["left"].model
    for excess in (1e-6, 0.003, JOINT_TOLERANCE):
        state = beyond(world, side, joint, excess)
        kept, notes = within_limits(world, state)
        assert kept.q["left"][joint] == model.position_limits[side, joint]
        np.testing.assert_array_equal(np.delete(kept.q["left"], joint), np.delete(state.q["left"], joint))
        (note,) = notes
        assert f"'left': {model.joint_names[joint]}" in note and f"{state.q['left'][joint]:.4f}" in note


@pytest.mark.parametrize("side", [0, 1])
def test_a_joint_far_beyond_a_limit_is_refused_with_joint_value_and_limits(world, side):
    state = beyond(world, side, 3, 0.02)
    text = rf"'left' has panda_joint4 at {state.q['left'][3]:.4f}; allowed: -3.0718 to -0.0698, and 0.01 beyond"
    for refused in (lambda: within_limits(world, state), lambda: plan(world, state),
                    lambda: plan_motion(world, "left", q=world.robots["left"].q, state=state),
                    lambda: without_noise(world, state, world.start_state())):  # fmt: skip
        with pytest.raises(InputError, match=text) as error:
            refused()
        assert error.value.code == Code.INVALID_INPUT


@pytest.mark.parametrize("finger", FINGER)
def test_fingers_a_little_beyond_their_limits_are_on_them(world, finger):
    state = world.start_state()
    state.gripper["left"] = 2.0 * finger
    kept, (note,) = within_limits(world, state)
    assert kept.gripper["left"] == (0.0 if finger < 0.0 else 0.08)
    assert "opening of the gripper" in note and f"{2.0 * finger:.4f}" in note


@pytest.mark.parametrize("opening", [-1.1 * OPENING_TOLERANCE, 0.083, np.nan])
def test_fingers_far_beyond_their_limits_are_refused(world, opening):
    state = world.start_state()
    state.gripper["left"] = opening
    with pytest.raises(InputError, match=r"fingers .* m apart \(panda_finger_joint1.*allowed: 0.0000 to 0.0800"):
        within_limits(world, state)


def test_fingers_may_be_where_the_urdf_allows_it_though_no_grasp_uses_that(world):
    robot = world.robots["left"]
    narrow = replace(robot.model, gripper=replace(robot.model.gripper, min_opening=0.01, open_opening=0.06))
    narrow_world = replace(world, robots={"left": replace(robot, model=narrow)})
    for opening in (0.0, 0.08):
        state = narrow_world.start_state()
        state.gripper["left"] = opening
        assert within_limits(narrow_world, state) == (state, ())


def test_a_state_within_the_limits_is_left_as_it_is(world):
    state = world.start_state()
    kept, notes = within_limits(world, state)
    assert kept is state and notes == ()


def test_lists_and_a_missing_opening_of_a_robot_without_gripper_are_completed(world):
    robot = world.robots["left"]
    bare = replace(world, robots={"left": replace(robot, model=replace(robot.model, gripper=None))})
    state = replace(bare.start_state(), q={"left": robot.q.tolist()}, gripper={})
    kept, notes = within_limits(bare, state)
    np.testing.assert_array_equal(kept.q["left"], robot.q)
    assert kept.gripper == {"left": 0.0} and notes == ()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda state: state.q.pop("left"), "lacks joints or gripper of robot 'left'"),
        (lambda state: state.gripper.pop("left"), "lacks joints or gripper of robot 'left'"),
        (lambda state: state.poses.pop("block"), "lacks poses of block"),
        (lambda state: state.q.update(left=np.zeros(6)), "needed: 7 finite joint positions"),
        (lambda state: state.q.update(left=np.full(7, np.nan)), "needed: 7 finite joint positions"),
    ],
)
def test_an_incomplete_state_is_refused(world, spoil, words):
    state = world.start_state()
    spoil(state)
    with pytest.raises(InputError, match=words):
        plan(world, state)


# --- every door


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return carry(tmp_path_factory.mktemp("task"))


def measured(task, finger: float):
    """The start of a task with the fingers and two joints measured beyond their limits."""
    state = task.start_state()
    model = task.robots["arm"].model
    state.q["arm"][[5, 6]] = model.position_limits[1, 5] + 0.004, model.position_limits[0, 6] - 0.004
    state.gripper["arm"] = 2.0 * finger
    return state


@pytest.mark.parametrize("finger", FINGER)
def test_a_task_is_planned_from_fingers_and_joints_measured_beyond_their_limits(task, finger):
    made = plan(task, measured(task, finger), seed=1)
    limits = task.robots["arm"].model.position_limits
    q, opening = made.trajectory.joints["arm"], made.trajectory.gripper["arm"]
    assert (q >= limits[0]).all() and (q <= limits[1]).all()
    assert opening.min() >= 0.0 and opening.max() <= 0.08
    assert len(made.stats["notes"]) == 3 and check(to_dict(made)).valid


def test_a_plan_is_repaired_from_joints_measured_beyond_their_limits(task):
    made = plan(task, seed=1)
    new, _ = plan_anew(made, 0.0, made.scene, measured(task, FINGER[0]), 1, time_limit=60.0)
    assert len(new.stats["notes"]) == 3
    assert check(to_dict(new)).valid


@pytest.mark.parametrize("finger", FINGER)
def test_a_motion_goes_from_and_to_what_was_measured_beyond_the_limits(task, finger):
    state, model = measured(task, finger), task.robots["arm"].model
    goal = model.home.copy()
    goal[4] = model.position_limits[0, 4] - 0.008
    made = plan_motion(task, "arm", q=goal, state=state)
    q = made.trajectory.joints["arm"]
    assert (q >= model.position_limits[0]).all() and (q <= model.position_limits[1]).all()
    assert q[-1, 4] == pytest.approx(model.position_limits[0, 4], abs=1e-4)
    assert [note.split(":")[0] for note in made.notes] == ["start of 'arm'"] * 3 + ["goal of 'arm'"]


def test_the_command_line_plans_from_a_scene_that_starts_beyond_a_limit(tmp_path, capsys):
    text = CARRY.format(
        model="panda", mode="physical", motion="auto", wall=0.05, wall_z=0.025, start=list(START), goal=list(GOAL)
    )
    model = carry(tmp_path).robots["arm"].model
    q = model.home.copy()
    q[6] = model.position_limits[1, 6] + 0.005
    file, out = tmp_path / "measured.yaml", tmp_path / "plan.json"
    start = f"q: {q.tolist()}, base"
    file.write_text(text.replace("base", start))
    assert main(["plan", str(file), "--out", str(out)]) == 0
    assert "panda_joint7 is measured at 2.9023, beyond its limit; 2.8973 is planned with" in capsys.readouterr().out
    assert load(out).trajectory.joints["arm"][0, 6] == model.position_limits[1, 6]
    file.write_text(text.replace("base", start.replace("2.9023", "2.9973")))
    assert main(["plan", str(file), "--out", str(out)]) == 2
    assert "robots.arm.q" in capsys.readouterr().err
