"""Press and drag: which presses are feasible, how they are planned, and how they are executed under dynamics."""

import json
from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import disc, plate, row
from simulation_fixtures import box, scene

from hmap_core import plan_file, planner
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Situation
from hmap_core.contacts.press import FORCES, Press, SlidingSupport, force_limit, press_reach
from hmap_core.contacts.press_efforts import PRESS_TIME
from hmap_core.contacts.surface import sample_surface
from hmap_core.exceptions import Code, HmapError, InputError
from hmap_core.execution.stretches import joint_trajectory, stretches
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner import search
from hmap_core.planner.strategies.pressed_path import PressedPath
from hmap_core.simulation.compliance import Compliance
from hmap_core.simulation.execute import execute, execute_closed_loop
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.transforms import apply, from_rpy, multiply_all, pose, rotation_matrix
from hmap_core.types import BodyKind, ContactKind, SegmentKind
from hmap_core.validation import check

SIZE = (0.12, 0.1, 0.01)
START = (0.5, 0.0, 0.005)
PLATE = box("plate", SIZE, START, mass=0.2, friction=0.5)
TABLE = replace(box("table", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), BodyKind.FIXED), friction=0.6)
MODEL = scene().robots["left"].model


def along(x: float, y: float, turn: float = 0.0, steps: int = 15) -> np.ndarray:
    """Poses (M, 7) of the plate on a straight way by (x, y) m, turned by an angle (rad) meanwhile."""
    shares = np.linspace(0.0, 1.0, steps + 1)
    return np.array([from_rpy((START[0] + s * x, START[1] + s * y, START[2]), (0.0, 0.0, s * turn)) for s in shares])


def press_on(body=PLATE, table=TABLE, poses=None, model=MODEL) -> Press:
    poses = along(0.15, 0.0) if poses is None else poses
    return Press(body, model, SlidingSupport.of(body, poses, [table]), poses[0])


def sampled(press: Press, body=PLATE):
    points, normals = sample_surface(body.shapes, 300, np.random.default_rng(0))
    cloud = Cloud(points, normals, np.ones(len(points), bool))
    return press.sampled(cloud, Situation(pose(START)), np.random.default_rng(1))


def least_force(poses: np.ndarray, **changes) -> float:
    """The least force of presses that last to the end of a path."""
    press = press_on(poses=poses, **changes)
    made = press.with_forces(sampled(press, changes.get("body", PLATE)), poses)
    return min((contact.force for contact, reach in made if reach == len(poses) - 1), default=np.inf)


def test_fingertips_stand_on_the_top_and_point_down():
    contacts = sampled(press_on())
    assert len(contacts) > 50
    arm = load_arm(MODEL)
    for contact in contacts:
        assert contact.kind is ContactKind.PRESS
        assert rotation_matrix(contact.T_obj_ee)[:, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
        tips = apply(contact.T_obj_ee, arm.finger_vertices(contact.opening))
        lowest = tips[tips[:, 2] <= tips[:, 2].min() + 1e-4]
        assert SIZE[2] / 2 < lowest[:, 2].min() < SIZE[2] / 2 + 1e-4
        assert (np.abs(lowest[:, :2]) < np.array(SIZE[:2]) / 2).all()
    assert len({contact.opening for contact in contacts}) > 1


def test_nothing_is_sampled_on_what_is_narrower_than_the_fingers():
    strip = box("plate", (0.12, 0.008, 0.01), START, friction=0.5)
    assert not sampled(press_on(strip), strip)


def test_a_press_needs_fingers_that_hold_better_than_the_support():
    assert press_on().possible
    assert not press_on(table=replace(TABLE, friction=0.85)).possible
    smooth = replace(MODEL, simulation=MODEL.simulation | {"finger_friction": 0.7})
    assert not press_on(model=smooth).possible
    assert not press_on(table=replace(TABLE, pose=pose((0.0, 0.0, -0.07)))).possible


def test_the_force_grows_with_mass_and_friction_of_the_support():
    light, heavy = (least_force(along(0.15, 0.0), body=replace(PLATE, mass=mass)) for mass in (0.1, 0.4))
    assert FORCES[0] <= light < heavy < np.inf
    smooth, rough = (least_force(along(0.15, 0.0), table=replace(TABLE, friction=mu)) for mu in (0.3, 0.7))
    assert smooth < rough < np.inf
    assert least_force(along(0.15, 0.0), body=replace(PLATE, mass=3.0)) == np.inf


def test_turning_needs_more_force_than_a_straight_drag():
    assert least_force(along(0.15, 0.0)) < least_force(along(0.15, 0.0, 1.0)) < np.inf


def test_no_arm_presses_with_more_than_its_payload():
    weak = replace(MODEL, payload=0.5)
    assert force_limit(weak) == pytest.approx(0.5 * 9.81)
    assert least_force(along(0.15, 0.0)) > force_limit(weak)
    assert least_force(along(0.15, 0.0), model=weak) == np.inf


def test_reach_ends_where_friction_or_support_does():
    poses = along(0.15, 0.0)
    press = press_on()
    middle, _ = press.with_forces(sampled(press), poses)[0]
    assert list(press_reach(PLATE, MODEL, [middle], poses, [TABLE])) == [len(poses) - 1]
    assert list(press_reach(PLATE, MODEL, [replace(middle, force=1.0)], poses, [TABLE])) == [0]
    assert list(press_reach(PLATE, MODEL, [replace(middle, force=100.0)], poses, [TABLE])) == [0]
    rising = poses.copy()
    rising[8:, 2] += 0.02
    assert list(press_reach(PLATE, MODEL, [middle], rising, [TABLE])) == [7]
    short = box("table", (1.1, 2.0, 0.1), (0.0, 0.0, -0.05), BodyKind.FIXED, friction=0.6)
    (reach,) = press_reach(PLATE, MODEL, [middle], poses, [short])
    pressed = multiply_all(poses, middle.T_obj_ee)[:, 0]
    assert 0 < reach < len(poses) - 1 and pressed[reach] < 0.55 < pressed[reach + 1] + 0.01
    grasp = replace(middle, kind=ContactKind.GRASP)
    assert list(press_reach(PLATE, MODEL, [grasp], poses, [short])) == [len(poses) - 1]


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):
    """A plan for a thin plate that no hand grips and no push overlaps."""
    return planner.plan(plate(tmp_path_factory.mktemp("plate")), seed=1)


def test_a_thin_plate_is_dragged_from_above(dragged):
    contacts = [segment for segment in dragged.segments if segment.kind is not SegmentKind.TRANSIT]
    assert {segment.kind for segment in contacts} == {SegmentKind.PRESS}
    assert all(segment.force in FORCES for segment in contacts)
    assert check(plan_file.to_dict(dragged)).valid


def test_the_hand_rests_while_the_force_builds_up(dragged):
    press = next(segment for segment in dragged.segments if segment.kind is SegmentKind.PRESS)
    time, q = dragged.trajectory.time, dragged.trajectory.joints["arm"]
    for start, end in ((press.start, press.start + PRESS_TIME), (press.end - PRESS_TIME, press.end)):
        still = q[(time >= start - 1e-9) & (time <= end + 1e-9)]
        assert np.ptp(still, axis=0).max() == 0.0
    stretch = next(own for own in stretches(dragged) if "press" in own.label)
    motion = joint_trajectory(dragged, "arm", stretch)
    robot = dragged.scene.robots["arm"]
    arm = load_arm(robot.model)
    forces = [
        np.linalg.pinv(arm.tip_jacobian(row).T) @ effort
        for row, effort in zip(motion.positions, motion.efforts, strict=True)
    ]
    assert np.abs(np.array(forces)[:, :2]).max() < 1e-6
    down = -np.array(forces)[:, 2]
    assert down[[0, -1]] == pytest.approx(0.0, abs=1e-9) and down.max() == pytest.approx(press.force)
    others = [joint_trajectory(dragged, "arm", own) for own in stretches(dragged) if "press" not in own.label]
    assert all(other.efforts is None for other in others)


def test_the_plan_file_keeps_the_force(dragged):
    document = json.loads(json.dumps(plan_file.to_dict(dragged)))
    again = plan_file.from_dict(document)
    assert [segment.force for segment in again.segments] == [segment.force for segment in dragged.segments]
    press = next(segment for segment in document["segments"] if segment["kind"] == "press")
    del press["force"]
    with pytest.raises(InputError, match="press segment needs a force") as failure:
        plan_file.from_dict(document)
    assert failure.value.code is Code.INVALID_PLAN_FILE
    press["kind"], press["force"] = "push", 5.0
    with pytest.raises(InputError, match="no other kind"):
        plan_file.from_dict(document)


def test_dragging_under_dynamics_keeps_the_force(dragged, monkeypatch):
    measured, original = [], Compliance._pressed

    def pressed(self, way):
        measured.append(original(self, way))
        return measured[-1]

    monkeypatch.setattr(Compliance, "_pressed", pressed)
    report = execute(dragged)
    assert report.solved, report.reason
    assert report.goal_error.position_m < 0.004 and report.goal_error.rotation_deg < 2.0
    force = next(segment.force for segment in dragged.segments if segment.force)
    steps = round(PRESS_TIME / SimulatedWorld.dt)
    whole = np.array(measured[steps:-steps])
    assert np.mean(whole) == pytest.approx(force, rel=0.15)


def test_without_the_force_the_plate_stays_behind(dragged):
    """The plan is executed as it is, but the hand only touches the plate."""
    softly = tuple(replace(s, force=0.01 if s.force else None) for s in dragged.segments)
    report = execute(replace(dragged, segments=softly))
    assert not report.solved


def test_a_plate_as_rough_below_as_the_fingers_is_refused(tmp_path):
    with pytest.raises(HmapError) as failure:
        planner.plan(plate(tmp_path, ground=0.95), seed=1, time_limit=30.0)
    assert failure.value.code in (Code.OUT_OF_REACH, Code.NO_CONTACT)


@pytest.mark.parametrize(
    ("width", "height", "drags"), [(0.1, 0.01, True), (0.1, 0.04, True), (0.1, 0.12, False), (0.04, 0.12, True)]
)
def test_high_objects_are_dragged_only_if_a_gripper_could_set_them_upright(width, height, drags):
    """A force at the top must not tip what is dragged: with a coefficient of 1, or of 1.25 times its own."""
    block = box("plate", (0.1, width, height), (0.5, 0.0, height / 2), mass=0.2, friction=0.5)
    poses = along(0.15, 0.0) + np.array([0, 0, height / 2 - START[2], 0, 0, 0, 0])
    press = press_on(block, poses=poses)
    made = press.with_forces(sampled(press, block), poses)
    assert (max((reach for _, reach in made), default=0) == len(poses) - 1) == drags


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)])
def test_presses_behind_the_middle_are_tried(way):
    """As far as the fingers, which are 11 mm wide across, stand on the top."""
    press, step = press_on(), np.array([*way, 0.0])
    points, normals = sample_surface(PLATE.shapes, 300, np.random.default_rng(0))
    cloud = Cloud(points, normals, np.ones(len(points), bool))
    there = pose(START) + np.array([*(0.01 * step), 0, 0, 0, 0])
    contacts = press.sampled(cloud, Situation(pose(START), there), np.random.default_rng(1))
    beside = [np.linalg.norm(np.cross(contact.point, step)[2]) for contact in contacts]
    behind = [-contact.point @ step for contact, off in zip(contacts, beside, strict=True) if off < 1e-6]
    assert len(set(np.round(behind, 6))) > 5
    assert max(behind) > 0.8 * np.abs(np.array(SIZE[:2]) / 2 / np.maximum(np.abs(step[:2]), 1e-9)).min() - 0.01


def test_a_narrow_object_is_not_dragged_sideways():
    block = box("plate", (0.04, 0.1, 0.12), (0.5, 0.0, 0.06), mass=0.2, friction=0.5)
    poses = along(0.15, 0.0) + np.array([0, 0, 0.06 - START[2], 0, 0, 0, 0])
    press = press_on(block, poses=poses)
    assert max((reach for _, reach in press.with_forces(sampled(press, block), poses)), default=0) == 0


def test_a_book_is_dragged_out_of_a_row_and_gripped_in_front_of_it(tmp_path):
    plan = planner.plan(row(tmp_path), seed=0)
    kinds = [segment.kind for segment in plan.segments if segment.kind is not SegmentKind.TRANSIT]
    assert kinds[0] is SegmentKind.PRESS and kinds[-1] is SegmentKind.GRASP


def test_what_can_be_gripped_is_not_dragged(tmp_path):
    plan = planner.plan(plate(tmp_path, size=(0.12, 0.05, 0.04)), seed=1)
    assert SegmentKind.PRESS not in {segment.kind for segment in plan.segments}


def test_a_disc_does_not_rattle_under_the_fingers(tmp_path, monkeypatch):
    """Bullet lets the flat end of a cylinder rattle on a box; it stands on the corners of boxes inside it instead."""
    monkeypatch.setattr(search, "PATH_STRATEGIES", (PressedPath(),))
    plan = planner.plan(disc(tmp_path), seed=1)
    assert SegmentKind.PRESS in {segment.kind for segment in plan.segments}
    tilts: list[float] = []

    def look(world, stretch):
        tilts.append(rotation_matrix(world.body_pose("disc"))[2, 2])

    report = execute_closed_loop(plan, None, 0, between=look).last
    assert report.solved and report.goal_error.position_m < 0.005, report.reason
    assert min(tilts) > np.cos(np.deg2rad(0.5))
