"""Preconditions: bodies that penetrate others or have no support, and goals that no arm can reach."""

from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import GOAL, START, carry
from simulation_fixtures import box

from hmap_core.exceptions import Code, ContactError, InputError, PlannerError
from hmap_core.planner import plan
from hmap_core.planner.preconditions import check_bodies, check_reach
from hmap_core.types import BodyKind

UNSUPPORTED = (0.5, 0.15, 0.4)


def with_bodies(scene, *bodies):
    return replace(scene, bodies=scene.bodies | {body.name: body for body in bodies})


@pytest.mark.parametrize(
    "place, other",
    [((0.7, 0.0, 0.03), "'table' by 10.0 mm"), ((*START[:2], 0.1), "'brick'"), ((0.0, 0.0, 0.1), "robot 'arm'")],
)
def test_a_body_in_something_at_its_start_is_named_with_its_key(tmp_path, place, other):
    scene = with_bodies(carry(tmp_path), box("can", (0.06, 0.06, 0.08), place))
    with pytest.raises(InputError, match=r"penetrates .* at its start \(movable\..*\.pose\); at most 1 mm") as error:
        plan(scene)
    assert error.value.code == Code.START_IN_COLLISION
    assert "'can'" in error.value.reason and other in error.value.reason


def test_what_was_measured_may_be_off_a_little(tmp_path):
    scene = with_bodies(carry(tmp_path), box("can", (0.06, 0.06, 0.08), (0.7, 0.0, 0.038)))
    with pytest.raises(InputError):
        plan(scene)
    with pytest.raises(PlannerError) as error:
        plan(scene, scene.start_state(), cancel=lambda: True)
    assert error.value.code == Code.CANCELED


@pytest.mark.parametrize(
    "change, code, says",
    [
        ({"start": UNSUPPORTED}, Code.INVALID_SCENE, r"at its start \(movable.brick.pose\)"),
        ({"goal": UNSUPPORTED}, Code.INVALID_POSE, r"at its goal \(goal.pose\)"),
    ],
)
def test_every_body_has_a_support_in_a_physical_task(tmp_path, change, code, says):
    scene = carry(tmp_path, **change)
    with pytest.raises(InputError, match=rf"'brick' .*(has|have) no support {says}: .*, [0-9]+ mm away") as error:
        check_bodies(scene, scene.goal)
    assert error.value.code == code
    kinematic = carry(tmp_path, mode="kinematic", **change)
    check_bodies(kinematic, kinematic.goal)


@pytest.mark.parametrize("what", ["start", "goal"])
def test_what_no_arm_can_reach_is_told_at_once(tmp_path, what):
    millimetres = tuple(1e3 * value for value in (START if what == "start" else GOAL))
    scene = carry(tmp_path, **{what: millimetres})
    with pytest.raises(ContactError, match=rf"the {what} of 'brick' at .* 'arm' is 52[0-9]\.\d\d m away") as error:
        check_reach(scene, scene.start_state(), scene.goal)
    assert error.value.code == Code.OUT_OF_REACH


def test_a_tool_lengthens_the_arm(tmp_path):
    scene = carry(tmp_path, goal=(1.6, 0.15, 0.04))
    with pytest.raises(ContactError):
        check_reach(scene, scene.start_state(), scene.goal)
    rake = box("rake", (0.9, 0.02, 0.02), (0.3, 0.6, 0.01), BodyKind.TOOL)
    longer = with_bodies(scene, rake)
    check_reach(longer, longer.start_state(), longer.goal)


@pytest.mark.parametrize(("apart", "between", "met"), [(2.2, None, True), (2.7, None, False), (2.7, 1.35, True)])
def test_robots_that_cannot_meet_are_told_at_once(tmp_path, apart, between, met):
    scene = carry(tmp_path, goal=(apart - 0.5, 0.15, 0.04))
    arm = scene.robots["arm"]
    places = {"other": apart} | ({"middle": between} if between else {})
    others = {name: replace(arm, name=name, base_pose=arm.base_pose + x * np.eye(7)[0]) for name, x in places.items()}
    scene = replace(scene, robots=scene.robots | others)
    if met:
        check_reach(scene, scene.start_state(), scene.goal)
        return
    with pytest.raises(
        ContactError, match=r"'arm' and 'other' are 2\.70 m apart and reach 1\.14 m and 1\.14 m"
    ) as error:
        check_reach(scene, scene.start_state(), scene.goal)
    assert error.value.code == Code.OUT_OF_REACH


def test_a_scene_as_it_should_be_passes(tmp_path):
    scene = carry(tmp_path)
    check_bodies(scene, scene.goal)
    check_reach(scene, scene.start_state(), scene.goal)
    assert np.isfinite(scene.goal.pose).all()
