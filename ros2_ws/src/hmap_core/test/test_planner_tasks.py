"""Real plans: a box past a wall, the tunnels, and what is said when there is no plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planner_fixtures import GOAL, START, carry, crate

from hmap_core.exceptions import Code, ContactError, HmapError, InputError, PlannerError
from hmap_core.komo.shapes import body_set
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan
from hmap_core.planner.conflicts import object_clearances
from hmap_core.planner.object_path import bases
from hmap_core.scenes import list_tasks, load_scene
from hmap_core.simulation.execute import execute
from hmap_core.transforms import distance, pose
from hmap_core.types import SegmentKind
from hmap_core.validation import check

TIME_LIMIT = 120.0  # s; a busy machine is slow
LONG = 600.0  # s
TUNNELS = ("tunnel", "published/tunnel")
EXAMPLE = Path(__file__).parents[4] / "docs" / "examples" / "hook.yaml"


def assert_solves(made, kind: SegmentKind) -> None:
    """The judge accepts it, the object is at its goal, contacts are of one kind, and segments follow without gaps."""
    report = check(to_dict(made))
    assert report.valid, report.violations[:3]
    goal = made.scene.goal
    apart = distance(made.trajectory.objects[goal.object][-1], goal.pose)
    assert apart[0] <= goal.position_tolerance and apart[1] <= goal.rotation_tolerance
    assert {s.kind for s in made.segments} == {SegmentKind.TRANSIT, kind}
    ends = [0.0, *(s.end for s in made.segments)]
    np.testing.assert_allclose([s.start for s in made.segments], ends[:-1], atol=1e-9)
    assert ends[-1] == pytest.approx(made.trajectory.time[-1])
    np.testing.assert_allclose(np.diff(made.trajectory.time), 0.02, atol=1e-9)
    assert made.stats["contacts"] == sum(s.kind != SegmentKind.TRANSIT for s in made.segments)
    assert len(made.waypoints) == made.stats["contacts"]


@pytest.mark.parametrize("motion", ["planar", "spatial"])
def test_a_panda_carries_a_box_past_a_wall(tmp_path, motion):
    made = plan(carry(tmp_path, motion=motion), seed=1, time_limit=TIME_LIMIT)
    assert_solves(made, SegmentKind.GRASP)
    highest = made.trajectory.objects["brick"][:, 2].max()
    assert (highest > 0.09) == (motion == "spatial")  # over the wall, or round it


def test_a_crate_that_no_hand_can_grip_is_pushed_past_a_wall_and_turned(tmp_path):
    made = plan(crate(tmp_path), seed=0, time_limit=TIME_LIMIT)
    assert_solves(made, SegmentKind.PUSH)
    report = execute(made)
    assert report.solved, report.reason


def test_a_panda_touches_a_box_past_a_wall(tmp_path):
    made = plan(carry(tmp_path, mode="kinematic", motion="planar"), seed=1, time_limit=TIME_LIMIT)
    assert_solves(made, SegmentKind.TOUCH)


def test_an_iiwa_touches_a_box_past_a_wall(tmp_path):
    scene = carry(tmp_path, model="iiwa", mode="kinematic", motion="planar", goal=(0.6, -0.3, 0.04))
    made = plan(scene, seed=1, time_limit=TIME_LIMIT)
    assert_solves(made, SegmentKind.TOUCH)


def test_an_arm_without_gripper_grasps_nothing_and_says_so(tmp_path):
    with pytest.raises(HmapError) as error:
        plan(carry(tmp_path, model="iiwa", motion="planar", goal=(0.6, -0.3, 0.04)), time_limit=20.0)
    assert error.value.stage in ("contacts", "motion", "planner") and error.value.reason


def test_the_same_seed_gives_the_same_plan(tmp_path):
    scene = carry(tmp_path, motion="planar")
    first, second, other = (plan(scene, seed=s, time_limit=TIME_LIMIT) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.trajectory.joints["arm"], second.trajectory.joints["arm"])
    np.testing.assert_array_equal(first.trajectory.objects["brick"], second.trajectory.objects["brick"])
    assert other.trajectory.joints["arm"].shape != first.trajectory.joints["arm"].shape or not np.array_equal(
        other.trajectory.joints["arm"], first.trajectory.joints["arm"]
    )


def test_a_plan_starts_from_the_state_that_is_given(tmp_path):
    scene = carry(tmp_path, motion="planar")
    state = scene.start_state()
    state.q["arm"][0] += 0.4
    state.poses["brick"][:2] += [0.05, -0.05]
    made = plan(scene, state, seed=1, time_limit=TIME_LIMIT)
    np.testing.assert_array_equal(made.trajectory.joints["arm"][0], state.q["arm"])
    np.testing.assert_array_equal(made.trajectory.objects["brick"][0], state.poses["brick"])
    assert scene.start_state().q["arm"][0] != state.q["arm"][0]


@pytest.mark.parametrize(
    "change, code",
    [({"start": (0.5, -0.01, 0.04)}, Code.START_IN_COLLISION), ({"goal": (0.5, 0.0, 0.04)}, Code.GOAL_IN_COLLISION)],
)
def test_an_object_in_the_wall_is_an_input_error(tmp_path, change, code):
    with pytest.raises(InputError, match=r"'brick' penetrates 'wall' by .* at its (start|goal)") as error:
        plan(carry(tmp_path, **change), time_limit=TIME_LIMIT)
    assert error.value.code == code


def test_an_object_goes_round_the_base_of_the_arm(tmp_path):
    scene = carry(tmp_path, start=(0.3, 0.3, 0.04), goal=(-0.3, -0.3, 0.04))
    (base,) = bases(scene, "brick", ())
    made = plan(scene, time_limit=TIME_LIMIT)
    assert_solves(made, SegmentKind.GRASP)
    assert object_clearances(body_set(scene.bodies["brick"]), made.trajectory.objects["brick"], base).min() > 0.0


def test_a_base_in_whose_box_the_object_stands_is_no_obstacle(tmp_path):
    scene = carry(tmp_path)
    assert [body.name for body in bases(scene, "brick", [pose(START), pose(GOAL)])] == ["arm"]
    assert bases(scene, "brick", [pose((0.05, 0.0, 0.04))]) == ()


def test_a_goal_out_of_reach_is_named(tmp_path):
    with pytest.raises(ContactError, match="goal of 'brick'.*out of reach of arm") as error:
        plan(carry(tmp_path, goal=(1.1, 0.3, 0.04)), time_limit=TIME_LIMIT)
    assert error.value.code == Code.OUT_OF_REACH


def test_an_object_out_of_reach_is_named(tmp_path):
    with pytest.raises(HmapError, match="no contact can move 'brick' .* too far for the arm") as error:
        plan(carry(tmp_path, start=(1.1, 0.3, 0.04)), time_limit=TIME_LIMIT)
    assert error.value.code == Code.NO_CONTACT


def test_time_limit_and_cancel_reach_the_real_backend(tmp_path):
    scene = carry(tmp_path)
    with pytest.raises(PlannerError) as error:
        plan(scene, time_limit=0.02)
    assert error.value.code == Code.TIME_LIMIT
    phases = []
    with pytest.raises(PlannerError) as error:
        plan(scene, progress=lambda p: phases.append(p.phase), cancel=lambda: "contacts" in phases)
    assert error.value.code == Code.CANCELED and phases[-1] == "contacts"


@pytest.mark.slow
@pytest.mark.parametrize("task, kind", [(TUNNELS[0], SegmentKind.GRASP), (TUNNELS[1], SegmentKind.TOUCH)])
def test_the_tunnels_are_planned(task, kind):
    made = plan(load_scene(task, 0), seed=0, time_limit=TIME_LIMIT)
    assert_solves(made, kind)


@pytest.mark.slow
@pytest.mark.parametrize("task", [name for name in list_tasks(unsolvable=False) if name not in TUNNELS])
def test_every_task_that_comes_with_hmap_is_planned(task):
    made = plan(load_scene(task, 0), seed=0, time_limit=LONG)
    report = check(to_dict(made))
    assert report.valid, report.violations[:3]


@pytest.mark.slow
def test_the_example_is_planned_with_its_hook_and_executed():
    made = plan(load_scene(str(EXAMPLE), 0), seed=0, time_limit=LONG)
    report = check(to_dict(made))
    assert report.valid, report.violations[:3]
    assert {s.object for s in made.segments if s.manipulator == "hook"} == {"box"}
    assert made.stats["removals"] == 3
    executed = execute(made)
    assert executed.solved, executed.reason


@pytest.mark.slow
@pytest.mark.parametrize("task", sorted(set(list_tasks()) - set(list_tasks(unsolvable=False))))
def test_what_cannot_be_reached_is_told(task):
    with pytest.raises(HmapError) as error:
        plan(load_scene(task, 0), seed=0, time_limit=LONG)
    assert error.value.code == Code.OUT_OF_REACH


@pytest.mark.slow
def test_the_same_seed_gives_the_same_tunnel():
    first, second = (plan(load_scene("tunnel", 2), seed=5, time_limit=TIME_LIMIT) for _ in range(2))
    assert to_dict(replace(first, stats={})) == to_dict(replace(second, stats={}))
