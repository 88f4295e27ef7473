"""Goals that are a little off what is possible: met within their tolerance, with a note; else refused."""

from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import GOAL, carry

from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan
from hmap_core.planner.attainable_goal import attainable_goal
from hmap_core.planner.preconditions import check_bodies
from hmap_core.transforms import from_rpy, pose
from hmap_core.types import Shape, ShapeKind
from hmap_core.validation import check

TOLERANCE = 0.005  # m


def with_goal(scene, position, rpy=(0.0, 0.0, 0.0), **tolerances):
    return scene.with_goal(replace(scene.goal, pose=from_rpy(position, rpy), **tolerances))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return carry(tmp_path_factory.mktemp("goal"))


def moved(scene):
    """The goal that is planned for, and the note."""
    goal, notes = attainable_goal(scene, scene.start_state(), scene.goal)
    return goal, notes


def test_a_goal_at_which_the_object_stands_is_left_as_it_is(scene):
    goal, notes = moved(scene)
    assert goal is scene.goal and notes == ()


@pytest.mark.parametrize("height", [-0.004, -0.0015, 0.0015, 0.004])
def test_a_goal_above_or_inside_of_its_support_is_put_onto_it(scene, height):
    off = with_goal(scene, (*GOAL[:2], GOAL[2] + height))
    goal, (note,) = moved(off)
    np.testing.assert_allclose(goal.pose[:3], GOAL, atol=1e-9)
    assert goal.position_tolerance == pytest.approx(TOLERANCE - abs(height))
    assert "goal of 'brick'" in note and f"{-1e3 * height:.1f}) mm" in note


def test_a_goal_that_leans_is_levelled_within_its_tolerance(scene):
    lean = np.deg2rad(1.8)
    off = with_goal(scene, GOAL, (lean, 0.0, 0.3), rotation_tolerance=float(np.deg2rad(2.0)))
    goal, notes = moved(off)
    assert len(notes) == 1
    up = transforms.rotation_matrix(goal.pose)[:, 2]
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-9)
    assert transforms.distance(goal.pose, off.goal.pose)[1] == pytest.approx(lean, abs=1e-6)


def test_a_goal_beside_a_wall_is_moved_out_of_it(scene):
    """The wall ends at y = 0.01; the brick is 5 cm wide."""
    off = with_goal(scene, (0.5, 0.032, 0.04))
    goal, notes = moved(off)
    assert len(notes) == 1 and goal.pose[1] >= 0.034 and goal.pose[2] == pytest.approx(0.04)
    assert transforms.distance(goal.pose, off.goal.pose)[0] < TOLERANCE


def test_in_a_kinematic_task_a_goal_only_has_to_be_free(tmp_path):
    kinematic = carry(tmp_path, mode="kinematic")
    above = with_goal(kinematic, (*GOAL[:2], GOAL[2] + 0.1))
    assert moved(above)[0] is above.goal
    goal, notes = moved(with_goal(kinematic, (*GOAL[:2], GOAL[2] - 0.003)))
    np.testing.assert_allclose(goal.pose[:3], GOAL, atol=1e-9)
    assert len(notes) == 1


def test_a_ball_is_put_onto_its_support_too(scene):
    ball = replace(scene.bodies["brick"], shapes=(Shape(ShapeKind.SPHERE, (0.03,)),))
    off = replace(with_goal(scene, (0.5, 0.15, 0.033)), bodies=scene.bodies | {"brick": ball})
    assert moved(off)[0].pose[2] == pytest.approx(0.03, abs=1e-6)


def test_what_may_be_removed_does_not_count(scene):
    other = replace(scene.bodies["brick"], name="other", pose=pose((*GOAL[:2], GOAL[2] + 0.003)))
    crowded = replace(scene, bodies=scene.bodies | {"other": other}, removable={"other": None})
    assert moved(crowded)[0] is crowded.goal


@pytest.mark.parametrize("height", [-0.004, 0.004])
def test_the_plan_meets_such_a_goal_and_says_so(scene, height):
    off = with_goal(scene, (*GOAL[:2], GOAL[2] + height))
    made = plan(off, seed=1)
    end = made.trajectory.objects["brick"][-1]
    assert transforms.distance(end, off.goal.pose)[0] <= TOLERANCE
    assert len(made.stats["notes"]) == 1 and check(to_dict(made)).valid


@pytest.mark.parametrize("as_written", [True, False])
@pytest.mark.parametrize("height", [0.0065, 0.009])
def test_a_goal_above_its_support_by_more_than_its_tolerance_is_refused_at_once(scene, height, as_written):
    off = with_goal(scene, (*GOAL[:2], GOAL[2] + height))
    with pytest.raises(
        InputError, match=rf"no support at its goal .*'table' is the nearest, {1e3 * height:.0f} mm"
    ) as error:
        plan(off, None if as_written else off.start_state())
    assert error.value.code == Code.INVALID_POSE
    with pytest.raises(InputError):
        check_bodies(off, off.goal)
