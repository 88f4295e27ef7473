"""Execution of hand-written plans: what is solved, and what each failure is called."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plan_fixtures import DT, drag_plan, tool_push_plan
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.execution.stretches import joint_trajectory, stretches
from hmap_core.simulation.execute import execute
from hmap_core.simulation.ports import simulated_ports
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import BodyKind, Goal, Plan, Scene, Segment, SegmentKind, TaskMode

SIZE = (0.06, 0.06, 0.06)
START = (0.5, -0.05, 0.03)
BY = np.array([0.0, 0.1, 0.0])
GOAL = Goal("box", transforms.pose((0.5, 0.05, 0.03)))


def with_box(*others, goal: Goal = GOAL, **changes) -> Scene:
    return scene(box("box", SIZE, START, **changes), *others, goal=goal)


@pytest.fixture(scope="module")
def dragged() -> Plan:
    return drag_plan(with_box(), "box", 0.06, BY)


@pytest.fixture(scope="module")
def executed(dragged):
    """The report on the dragged box, and the progress that was told."""
    progress = []
    return execute(dragged, lambda *told: progress.append(told)), progress


@pytest.fixture(scope="module")
def lifted() -> Plan:
    return drag_plan(with_box(), "box", 0.06, BY, lift=0.1)


def test_dragging_a_box_is_solved_within_millimetres(executed):
    report, _ = executed
    assert report.solved and report.code is Code.SUCCESS and report.reason == ""
    assert report.goal_error.position_m < 0.002 and report.goal_error.rotation_deg < 1.0
    assert not report.fell and not report.moved and report.tracking_error_max < 0.005
    (drift,) = report.drift
    assert (drift.kind, drift.robot, drift.object) == (SegmentKind.GRASP, "left", "box")
    assert drift.end.position_m < 0.002


@pytest.mark.parametrize("seed", range(3))
def test_dragging_copes_with_mass_friction_and_a_misplaced_start(dragged, seed):
    rng = np.random.default_rng(seed)
    there = transforms.from_rpy(START + np.r_[rng.uniform(-0.003, 0.003, 2), 0.0], (0, 0, rng.uniform(-0.05, 0.05)))
    body = box("box", SIZE, START, mass=rng.uniform(0.2, 0.6), friction=rng.uniform(0.4, 0.8))
    report = execute(replace(dragged, scene=scene(replace(body, pose=there), goal=GOAL)))
    assert report.solved and report.goal_error.position_m < 0.005 and report.goal_error.rotation_deg < 4.0


def test_lifting_carrying_and_setting_down_is_solved(lifted):
    report = execute(lifted)
    assert report.solved and report.goal_error.position_m < 0.002


def test_the_same_plan_gives_the_same_report(dragged, executed):
    assert execute(dragged) == executed[0]


def test_a_grasp_of_nothing_is_named():
    report = execute(drag_plan(with_box(), "box", 0.06, BY, offset=(0.0, 0.0, 0.08)))
    assert not report.solved and report.code is Code.OBJECT_DROPPED
    assert "gripper of 'left'" in report.reason and "without 'box'" in report.reason
    assert report.goal_error.position_m == pytest.approx(0.1, abs=1e-3) and report.drift == ()


@pytest.mark.parametrize("changes", [{"mass": 15.0}, {"mass": 1.0, "friction": 0.01}])
def test_an_object_that_does_not_come_along_is_dropped(lifted, changes):
    report = execute(replace(lifted, scene=with_box(**changes)))
    assert not report.solved and report.code is Code.OBJECT_DROPPED and "'box'" in report.reason


def test_letting_go_too_early_is_a_fall(lifted):
    grasp = lifted.segments[1]
    middle = 0.5 * (grasp.start + grasp.end)
    time = lifted.trajectory.time
    # open while the object is lifted, at an instant of rest: the top of the lift
    height = lifted.trajectory.objects["box"][:, 2]
    up = float(time[np.argmax(height > height.max() - 1e-6)])
    opening = np.where(time > up + 0.02, 0.08, lifted.trajectory.gripper["left"])
    early = replace(
        lifted,
        trajectory=replace(lifted.trajectory, gripper={"left": opening}),
        segments=(
            lifted.segments[0],
            replace(grasp, end=up),
            Segment(up, float(time[-1]), "left", "panda_hand", None, SegmentKind.TRANSIT),
        ),
    )
    assert grasp.start < up < middle
    report = execute(early)
    assert not report.solved and report.code is Code.OBJECT_DROPPED and report.fell == ("box",)
    assert "fell" in report.reason


def test_a_wall_in_the_way_stops_the_robot():
    wall = box("wall", (0.5, 0.03, 0.3), (0.5, 0.12, 0.15), BodyKind.FIXED)
    report = execute(drag_plan(with_box(wall), "box", 0.06, BY))
    assert not report.solved and report.code is Code.TRACKING_LOST
    assert "joint" in report.reason and "'left'" in report.reason


def test_pushing_another_body_along_is_not_solved():
    report = execute(drag_plan(with_box(box("other", SIZE, (0.5, 0.05, 0.03))), "box", 0.06, BY))
    assert not report.solved and report.code is Code.GOAL_MISSED and report.moved == ("other",)
    assert "'other' should stay" in report.reason


def test_toppling_another_body_is_a_fall():
    report = execute(drag_plan(with_box(box("book", (0.2, 0.02, 0.2), (0.5, 0.06, 0.1))), "box", 0.06, BY))
    assert not report.solved and "book" in report.fell and report.code is Code.OBJECT_DROPPED


@pytest.mark.parametrize(
    "goal, word",
    [
        (transforms.pose((0.5, 0.09, 0.03)), "0.040 m and 0.0 deg"),
        (transforms.from_rpy((0.5, 0.05, 0.03), (0, 0, np.deg2rad(20))), "0.000 m and 20.0 deg"),
    ],
)
def test_ending_elsewhere_misses_the_goal(dragged, goal, word):
    report = execute(replace(dragged, scene=dragged.scene.with_goal(Goal("box", goal))))
    assert not report.solved and report.code is Code.GOAL_MISSED
    assert word in report.reason and "0.020 m and 10.0 deg are allowed" in report.reason


def test_an_object_that_the_plan_leaves_without_support_falls():
    report = execute(drag_plan(scene(box("box", SIZE, (0.5, -0.05, 0.3)), goal=GOAL), "box", 0.06, BY))
    assert not report.solved and report.fell == ("box",)


def test_progress_names_what_is_done(dragged, executed):
    _, seen = executed
    assert any("grasp box" in text for _, _, text in seen)
    times = [now for now, _, _ in seen]
    assert times == sorted(times) and all(end == dragged.trajectory.time[-1] for _, end, _ in seen)


def test_report_is_plain_data(executed):
    data = json.loads(json.dumps(executed[0].to_dict()))
    assert data["solved"] is True and set(data["goal_error"]) == {"position_m", "rotation_deg"} and data["reason"] == ""


def test_execution_can_be_driven_stretch_by_stretch(dragged):
    with SimulatedWorld(dragged.scene) as world:
        ports = simulated_ports(world)
        execution = PlanExecutor(ports).begin(dragged)
        grasp = next(i for i, s in enumerate(execution.stretches) if s.held)
        for stretch in execution.stretches[:grasp]:
            execution.follow(stretch)
        assert ports.observation.state().poses["box"][:3] == pytest.approx(START, abs=2e-3)
        execution.follow(execution.stretches[grasp])
        assert ports.observation.state().poses["box"][:3] == pytest.approx(START + BY, abs=2e-3)


def test_stretches_cover_the_plan_and_separate_gripper_and_arm(dragged):
    pieces = stretches(dragged)
    assert pieces[0].first == 0 and pieces[-1].last == len(dragged.trajectory.time) - 1
    assert all(a.last == b.first for a, b in zip(pieces, pieces[1:], strict=False))
    for piece in pieces:
        rows = slice(piece.first, piece.last + 1)
        arm = np.ptp(dragged.trajectory.joints["left"][rows], axis=0).max()
        fingers = np.ptp(dragged.trajectory.gripper["left"][rows])
        assert arm < 1e-9 or fingers < 1e-9
        assert (arm < 1e-9) or not joint_trajectory(dragged, "left", piece).velocities[[0, -1]].any()
    assert [p.held for p in pieces if p.held] == [{"left": "box"}]


def test_no_stretch_is_cut_while_an_arm_moves(dragged):
    grasp = dragged.segments[1]
    middle = DT * round(0.5 * (grasp.start + grasp.end) / DT)
    split = (dragged.segments[0], replace(grasp, end=middle), replace(grasp, start=middle), dragged.segments[2])
    assert len(stretches(replace(dragged, segments=split))) == len(stretches(dragged))


def test_a_tool_stays_gripped_while_it_pushes():
    plan = tool_push_plan(Goal("box", transforms.pose((0.45, 0.08, 0.03))))
    report = execute(plan)
    assert report.solved, report.reason
    assert [d.object for d in report.drift] == ["stick", "box"]
    assert all(piece.held == {"left": "stick"} for piece in stretches(plan)[3:])


@pytest.mark.parametrize(
    "change, code, word",
    [
        (lambda p: replace(p, scene=replace(p.scene, mode=TaskMode.KINEMATIC)), Code.INVALID_INPUT, "kinematic"),
        (lambda p: with_segment(p, kind=SegmentKind.TOUCH), Code.INVALID_INPUT, "touch"),
        (lambda p: with_segment(p, robot="nobody"), Code.INVALID_PLAN_FILE, "nobody"),
        (lambda p: with_segment(p, object="nothing"), Code.INVALID_PLAN_FILE, "nothing"),
        (lambda p: with_segment(p, end=-1.0), Code.INVALID_PLAN_FILE, "-1.0"),
        (lambda p: with_trajectory(p, joints={}), Code.INVALID_PLAN_FILE, "joints of 'left'"),
        (lambda p: with_trajectory(p, gripper={}), Code.INVALID_PLAN_FILE, "gripper of 'left'"),
        (lambda p: with_trajectory(p, time=p.trajectory.time[::-1]), Code.INVALID_PLAN_FILE, "times"),
        (lambda p: with_trajectory(p, joints={"left": np.nan * p.trajectory.joints["left"]}), None, "finite"),
        (
            lambda p: with_trajectory(p, joints={"left": p.trajectory.joints["left"] + 0.3}),
            Code.INVALID_PLAN_FILE,
            "starts 0.3",
        ),
        (lambda p: with_trajectory(p, gripper={"left": p.trajectory.gripper["left"] + 0.3}), None, "opening"),
    ],
)
def test_plans_that_cannot_be_executed_are_refused(dragged, change, code, word):
    with pytest.raises(InputError, match=word) as error:
        execute(change(dragged))
    assert code is None or error.value.code is code


def with_segment(plan: Plan, **changes) -> Plan:
    return replace(plan, segments=(plan.segments[0], replace(plan.segments[1], **changes)))


def with_trajectory(plan: Plan, **changes) -> Plan:
    return replace(plan, trajectory=replace(plan.trajectory, **changes))
