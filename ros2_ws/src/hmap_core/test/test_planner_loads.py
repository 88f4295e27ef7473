"""What stands on bodies that have to move, and what bodies weigh: removed first, lifted or pushed, or told at once."""

from dataclasses import replace

import numpy as np
import pytest
from obstacle_fixtures import task
from tool_fixtures import push_out

from hmap_core.contacts.grip_force import lifting_problem, pad_friction, sliding_problem, weight_ratio
from hmap_core.exceptions import Code, ContactError, HmapError, WaypointError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan
from hmap_core.planner.loads import has_to_be_lifted
from hmap_core.planner.obstruction import stacked_on
from hmap_core.planner.preconditions import check_loads, check_weight
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, ContactKind, ContactPoint, Goal, SegmentKind, TaskMode
from hmap_core.validation import check

TIME_LIMIT = 120.0  # s; a busy machine is slow
START, GOAL = (0.5, -0.15, 0.04), (0.5, 0.2, 0.04)  # of the brick, which is 8 cm high
LEVELS = (0.1, 0.14, 0.18)  # m, heights of the middle of boxes of 4 cm that stand on it, on each other


def stacked(folder, removable=("box_0",), count=1, start=START, goal=GOAL, **options):
    """A brick with a stack of boxes on it."""
    boxes = {f"box_{k}": ((0.04, 0.04, 0.04), (*START[:2], LEVELS[k])) for k in range(count)}
    return task(folder, "Loaded.", {}, boxes, dict.fromkeys(removable), start, goal, **options)


def moved(made) -> list[str]:
    """The objects of the plan's contacts in the order in which they are moved."""
    return list(dict.fromkeys(s.object for s in made.segments if s.object))


@pytest.mark.parametrize("mode", ["physical", "kinematic"])
def test_removable_body_on_the_object_is_removed_first(tmp_path, mode):
    made = plan(stacked(tmp_path, mode=mode), seed=1, time_limit=TIME_LIMIT)
    assert check(to_dict(made)).valid
    assert moved(made) == ["box_0", "brick"] and made.stats["removals"] == 1


def test_stack_on_the_object_goes_from_its_top(tmp_path):
    names = ("box_0", "box_1", "box_2")
    made = plan(stacked(tmp_path, names, 3, motion="auto"), seed=1, time_limit=TIME_LIMIT)
    assert check(to_dict(made)).valid
    assert moved(made) == ["box_2", "box_1", "box_0", "brick"]


@pytest.mark.parametrize(
    ("removable", "count", "says"),
    [
        ((), 1, "'brick' carries 'box_0', which would fall and may not be moved: list it under `removable`"),
        (("box_0",), 2, "'box_0' carries 'box_1', which would fall"),
        (("box_0", "box_1"), 3, "'box_1' carries 'box_2', which would fall"),
    ],
)
def test_body_on_top_that_may_not_be_moved_is_told_at_once(tmp_path, removable, count, says):
    seen = []
    with pytest.raises(WaypointError, match=says) as error:
        plan(stacked(tmp_path, removable, count), seed=1, progress=seen.append)
    assert error.value.code == Code.NO_OBJECT_PATH
    assert not any(progress.phase == "contacts" for progress in seen)


def test_body_on_an_object_that_is_at_its_goal_may_stay(tmp_path):
    scene = stacked(tmp_path, (), goal=START)
    check_loads(scene, scene.start_state(), scene.goal)


def test_stack_is_named_from_below_to_the_top(tmp_path):
    scene = stacked(tmp_path, (), 3)
    assert stacked_on(scene, scene.start_state(), "brick") == ("box_0", "box_1", "box_2")
    assert stacked_on(scene, scene.start_state(), "box_2") == ()


def loaded_stick(folder, removable: bool):
    """The stick that pushes a crate out of a tunnel, with a box on it."""
    scene = push_out(folder)
    box = replace(scene.bodies["cube"], name="box", kind=BodyKind.MOVABLE, pose=pose((0.40, 0.25, 0.115)))
    return replace(
        scene, bodies=scene.bodies | {"box": box}, removable=scene.removable | ({"box": None} if removable else {})
    )


def test_removable_body_on_a_tool_is_removed_first(tmp_path):
    made = plan(loaded_stick(tmp_path, True), seed=1, time_limit=TIME_LIMIT)
    assert check(to_dict(made)).valid
    assert moved(made)[:2] == ["box", "stick"]


def test_tool_that_carries_what_may_not_be_moved_is_not_used(tmp_path):
    with pytest.raises(HmapError) as error:
        plan(loaded_stick(tmp_path, False), seed=1, time_limit=15.0)
    assert error.value.code != Code.PLAN_REJECTED
    assert "tool 'stick' carries 'box', which may not be moved" in str(error.value.search) + error.value.reason


# weights


def heavy(folder, mass: float, goal=GOAL, friction=0.6, **model):
    """A brick of some mass, wanted elsewhere; ``model`` changes the robot's."""
    walls = {"step": ((0.2, 0.2, 0.06), (0.5, 0.35, 0.03))}
    scene = task(folder, "Heavy.", walls, {}, {}, START, goal, motion="auto")
    brick = replace(scene.bodies["brick"], mass=mass, friction=friction)
    arm = replace(scene.robots["arm"], model=replace(scene.robots["arm"].model, **model))
    return replace(scene, bodies=scene.bodies | {"brick": brick}, robots={"arm": arm})


UP = (0.5, 0.35, 0.1)  # on the step


@pytest.mark.parametrize(
    ("mass", "model", "says"),
    [
        (22.5, {}, r"'brick' weighs 22.5 kg, .*carries at most 3 kg \(payload\) and the pads .* hold 48.0 N \(2 x"),
        (3.1, {}, r"'brick' weighs 3.1 kg, which no robot can lift: 'arm' carries at most 3 kg \(payload\)$"),
        (6.0, {"payload": None}, r"hold 48.0 N \(2 x friction 0.6 x 40 N\), and 62.5 N are needed"),
        (0.1, {"gripper": None}, "'arm' has no gripper"),
    ],
)
def test_weight_that_no_robot_can_lift_is_refused_with_numbers(tmp_path, mass, model, says):
    scene = heavy(tmp_path, mass, UP, **model)
    with pytest.raises(ContactError, match=says) as error:
        check_weight(scene, scene.start_state(), scene.goal)
    assert error.value.code == Code.NO_CONTACT


def test_weight_is_told_before_the_search(tmp_path):
    seen = []
    with pytest.raises(ContactError, match="weighs 22.5 kg"):
        plan(heavy(tmp_path, 22.5, UP), progress=seen.append)
    assert not any(progress.phase == "contacts" for progress in seen)


def test_weight_within_payload_and_grip_is_lifted_and_accepted(tmp_path):
    made = plan(heavy(tmp_path, 2.5, UP), seed=1, time_limit=TIME_LIMIT)
    report = check(to_dict(made))
    assert report.valid, report.violations


def test_what_is_too_heavy_to_lift_is_pushed(tmp_path):
    scene = heavy(tmp_path, 4.5)  # friction with the table takes 26 N, the payload is 29 N
    check_weight(scene, scene.start_state(), scene.goal)
    made = plan(scene, seed=1, time_limit=TIME_LIMIT)
    assert check(to_dict(made)).valid
    assert np.ptp(made.trajectory.objects["brick"][:, 2]) < 1e-3
    assert all(s.kind in (SegmentKind.PUSH, SegmentKind.TRANSIT, SegmentKind.GRASP) for s in made.segments)


def test_what_is_too_heavy_to_push_is_refused_with_numbers(tmp_path):
    scene = heavy(tmp_path, 9.0)
    with pytest.raises(ContactError, match=r"sliding it takes 53.0 N .* pushes with at most 29.4 N \(payload 3 kg\)"):
        check_weight(scene, scene.start_state(), scene.goal)
    smooth = heavy(tmp_path, 9.0, friction=0.2)
    check_weight(smooth, smooth.start_state(), smooth.goal)


def test_weights_count_only_in_physical_tasks(tmp_path):
    scene = heavy(tmp_path, 22.5, UP)
    kinematic = replace(scene, mode=TaskMode.KINEMATIC)
    check_weight(kinematic, kinematic.start_state(), kinematic.goal)


def test_obstacle_that_is_too_heavy_is_told_with_its_weight(tmp_path):
    boxes = {"box": ((0.05, 0.05, 0.08), (*GOAL[:2], 0.04))}
    scene = task(tmp_path, "Blocked.", {}, boxes, {"box": None}, START, GOAL, mass=30.0)
    with pytest.raises(HmapError, match="'box' is in the way of 'brick' and cannot be removed: .*'box' weighs 30 kg"):
        plan(scene, seed=1, time_limit=TIME_LIMIT)


def test_what_has_to_be_lifted_changes_height_or_tilt():
    start = pose((0.5, 0.0, 0.04))
    assert not has_to_be_lifted(start, Goal("x", pose((0.9, 0.2, 0.043), (0.0, 0.0, 1.0, 0.0))))
    assert has_to_be_lifted(start, Goal("x", pose((0.9, 0.2, 0.06))))
    assert has_to_be_lifted(start, Goal("x", pose((0.5, 0.0, 0.0))))
    assert has_to_be_lifted(start, Goal("x", pose((0.5, 0.0, 0.04), (np.sin(0.1), 0.0, 0.0, np.cos(0.1)))))


def contact(closing_up: bool) -> ContactPoint:
    """A grasp whose closing axis is level, or vertical."""
    turn = (np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)) if closing_up else (0.0, 0.0, 0.0, 1.0)
    axis = np.array([0.0, 0.0, 1.0])
    return ContactPoint(ContactKind.GRASP, pose((0.0, 0.0, 0.0), turn), np.zeros(3), axis, 0.04, axis)


def test_friction_holds_across_the_closing_axis_and_one_finger_along_it(tmp_path):
    scene = heavy(tmp_path, 2.0, friction=0.3)
    body, model = scene.bodies["brick"], scene.robots["arm"].model
    push = replace(contact(False), kind=ContactKind.PUSH)
    up = np.array([0.0, 0.0, 1.0])
    across, along, none = weight_ratio(body, [contact(False), contact(True), push], model, up)
    assert across == pytest.approx(2.0 * 10.41 / (2.0 * 0.3 * 40.0))
    assert along == pytest.approx(2.0 * 10.41 / 40.0)
    assert none == 0.0
    rubber = replace(model, simulation=model.simulation | {"finger_friction": 0.1})
    assert pad_friction(body, rubber) == 0.1 and pad_friction(body, model) == 0.3
    assert not lifting_problem(body, "arm", model) and not sliding_problem(body, "arm", model)
