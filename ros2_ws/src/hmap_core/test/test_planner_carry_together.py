"""Two arms carry what no one carries alone: shares of the weight, the closed chain, and why there is no pair."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hmap_core import plan_file, planner
from hmap_core.contacts.shared_load import capacity, load_shares, pairs_hold
from hmap_core.exceptions import Code, HmapError
from hmap_core.planner.lifting import LIFT, raised_at_ends
from hmap_core.planner.loads import needs_two_robots
from hmap_core.planner.segments.attached import end_effector_poses
from hmap_core.planner.shared_grasps import SharedGrasps
from hmap_core.scenes import load_scene
from hmap_core.simulation.execute import execute
from hmap_core.transforms import distance, inverse, multiply
from hmap_core.types import ContactKind, ContactPoint, SegmentKind
from hmap_core.validation import check

TASK = """
schema: 1
description: A bar that is too heavy for one arm is laid on two posts.
mode: physical
fixed:
  table: {{shape: box, size: [2.4, 2.6, 0.1], pose: {{xyz: [0.4, 0, -0.05]}}}}
  post_left: {{shape: box, size: [0.07, 0.07, 0.12], pose: {{xyz: [0.56, 0.12, 0.06]}}}}
  post_right: {{shape: box, size: [0.07, 0.07, 0.12], pose: {{xyz: [0.56, -0.12, 0.06]}}}}
movable:
  bar: {{shape: box, size: [0.045, 0.9, 0.045], pose: {{xyz: [0.41, 0, 0.0225]}}, mass: {mass}, friction: 0.9}}
robots:
  left: {{model: panda, base: {{xyz: [0, 0.4, 0]}}}}
  right: {{model: panda, base: {{xyz: [0, {y}, 0]}}}}
goal: {{object: bar, pose: {{xyz: [0.56, 0, 0.1425]}}, position_tolerance: 0.01}}
"""
HEAVY, LIGHT, TOO_HEAVY = 4.2, 0.4, 7.0  # kg; a Panda carries 3 kg
HAND_APART = 5e-4  # m that one hand may move against the other


@pytest.fixture(scope="module")
def scene_of(tmp_path_factory):
    def scene(mass: float, y: float = -0.4):
        file = tmp_path_factory.mktemp("two_arms") / "task.yaml"
        file.write_text(TASK.format(mass=mass, y=y))
        return load_scene(str(file))

    return scene


@pytest.fixture(scope="module")
def plan(scene_of):
    return planner.plan(scene_of(HEAVY), seed=0)  # the judge has accepted it


def grasp(y: float) -> ContactPoint:
    """A grasp from above at a place along y."""
    T = np.array([0.0, y, 0.0, 1.0, 0.0, 0.0, 0.0])
    return ContactPoint(ContactKind.GRASP, T, T[:3], np.array([1.0, 0.0, 0.0]), 0.045, np.array([0.0, 0.0, 1.0]))


def test_shares_follow_the_lever_arms():
    first, second = np.array([[0.0, -0.3, 0.0]]), np.array([[0.0, 0.1, 0.02], [0.0, 0.3, 0.0]])
    share, beside, lever = load_shares(first, second, np.array([0.01, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(share, [[0.25, 0.5]])
    np.testing.assert_allclose(beside, [[0.01, 0.01]])
    np.testing.assert_allclose(lever, [[0.4, 0.6]])


def test_a_pair_holds_where_each_hand_stays_within_its_payload(scene_of):
    scene = scene_of(HEAVY)
    robots = scene.robots["left"], scene.robots["right"]
    contacts = [grasp(0.3), grasp(0.05)], [grasp(-0.3), grasp(0.2)]
    holds, share = pairs_hold(scene.bodies["bar"], robots, contacts, np.array([0.0, 0.0, 1.0]))
    # evenly; too much for the hand near the middle; not between the hands
    np.testing.assert_array_equal(holds, [[True, False], [False, False]])
    assert share[0, 0] == pytest.approx(0.5) and share[1, 0] == pytest.approx(0.3 / 0.35)
    assert capacity(scene.bodies["bar"], robots[0].model) == pytest.approx(robots[0].model.payload)


def test_two_robots_are_needed_only_for_what_none_carries_alone(scene_of):
    for mass, wanted in ((LIGHT, False), (HEAVY, True), (TOO_HEAVY, False)):
        scene = scene_of(mass)
        assert needs_two_robots(scene, "bar", scene.bodies["bar"].pose, scene.goal) is wanted


def test_what_is_raised_leaves_and_reaches_its_supports_vertically():
    path = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (11, 1))
    path[:, 0] = np.linspace(0.0, 0.1, 11)
    higher = raised_at_ends(path)
    np.testing.assert_array_equal(higher[[0, -1]], path[[0, -1]])
    low = higher[:, 2] < LIFT - 1e-9
    assert low.sum() > 2 and set(np.round(higher[low, 0], 9)) == {0.0, 0.1}


def test_both_arms_carry_the_bar_at_the_same_time(plan):
    both = [s for s in plan.segments if s.kind == SegmentKind.GRASP]
    (carried,) = {(s.start, s.end) for s in both if sum(t.start == s.start for t in both) == 2}
    assert {s.robot for s in both if (s.start, s.end) == carried} == {"left", "right"}
    time = plan.trajectory.time
    during = (time >= carried[0]) & (time <= carried[1])
    hands = {}
    for name, q in plan.trajectory.joints.items():
        assert np.ptp(q[during], axis=0).max() > 0.05  # both move
        hands[name] = end_effector_poses(plan.scene, name, q[during])
    relative = [multiply(inverse(a), b) for a, b in zip(*hands.values(), strict=True)]
    assert max(distance(T, relative[0])[0] for T in relative) < HAND_APART
    bar = plan.trajectory.objects["bar"]
    np.testing.assert_allclose(bar[~during & (time < carried[0])], np.tile(bar[0], ((time < carried[0]).sum(), 1)))


def test_the_plan_file_carries_two_robots_in_one_segment(plan, tmp_path):
    file = tmp_path / "plan.json"
    plan_file.save(plan, file)
    report = check(json.loads(file.read_text()))
    assert report.valid, report.violations
    again = plan_file.load(file)
    assert [(s.robot, s.kind, s.object) for s in again.segments] == [(s.robot, s.kind, s.object) for s in plan.segments]


def test_one_hand_that_lets_go_is_too_weak(plan):
    content = plan_file.to_dict(plan)
    segment = next(s for s in content["segments"] if s["robot"] == "right" and s["kind"] == "grasp")
    cut = [s for s in content["segments"] if s is not segment and s["robot"] == "right" and s["kind"] == "grasp"]
    for own in [segment, *cut]:
        own |= {"kind": "transit", "object": None, "contact_pose": None}
    found = {str(violation.kind) for violation in check(content).violations}
    assert "payload" in found


def test_the_simulated_arms_carry_the_bar(plan):
    report = execute(plan)
    assert report.solved, report.reason
    assert report.goal_error.position_m < 0.005


def test_one_arm_alone_carries_what_it_can(scene_of):
    plan = planner.plan(scene_of(LIGHT), seed=0)
    assert len({s.robot for s in plan.segments if s.kind != SegmentKind.TRANSIT}) == 1


@pytest.mark.parametrize(
    ("mass", "y", "reason"),
    [
        (TOO_HEAVY, -0.4, "two robots together carry too little as well: 'left' 3 kg and 'right' 3 kg"),
        (HEAVY, -1.9, "two robots cannot carry 'bar' together"),
    ],
)
def test_why_no_two_robots_carry_it(scene_of, mass, y, reason):
    with pytest.raises(HmapError) as error:
        planner.plan(scene_of(mass, y), seed=0)
    assert error.value.code == Code.NO_CONTACT and reason in error.value.reason


def test_two_arms_do_not_lift_in_a_planar_task(scene_of):
    scene = scene_of(HEAVY)
    with pytest.raises(HmapError) as error:
        planner.plan(replace(scene, motion="planar"), seed=0)
    assert "planar" in error.value.reason


def test_pairs_are_apart_and_unlike(scene_of):
    scene = scene_of(HEAVY)
    ends = scene.bodies["bar"].pose, scene.goal.pose
    grasps = SharedGrasps(scene, scene.start_state(), "bar", ends, np.random.default_rng(0))
    found = [pair for _, pair in zip(range(4), grasps.pairs(), strict=False)]
    assert len(found) == 4
    for pair in found:
        assert pair.robots == ("left", "right") and 0.0 <= pair.share <= 1.0
        a, b = (contact.T_obj_ee[:3] for contact in pair.contacts)
        assert np.linalg.norm(a - b) > 0.1


LEVEL = """
schema: 1
description: A bar is brought to another place on a table by two arms.
mode: physical
fixed:
  table: {{shape: box, size: [2.4, 2.6, 0.1], pose: {{xyz: [0.4, 0, -0.05]}}}}
movable:
  bar:
    {{shape: box, size: [0.05, 0.8, 0.05], pose: {{xyz: [0.42, 0, 0.025]}}, mass: {mass}, friction: {friction}{more}}}
{others}
robots:
  left: {{model: panda, base: {{xyz: [0, 0.4, 0]}}}}
  right: {{model: panda, base: {{xyz: [0, -0.4, 0]}}}}
goal: {{object: bar, pose: {{xyz: [0.58, 0, 0.025]}}}}
removable: {{{removable}}}
"""
CAN = "  can: {shape: cylinder, size: [0.025, 0.08], pose: {xyz: [{at}]}, mass: 0.1, friction: 0.7}"
AT_THE_ENDS = ", graspable: [{lower: [-0.03, -0.41, -0.03], upper: [0.03, -0.25, 0.03]}, \
{lower: [-0.03, 0.25, -0.03], upper: [0.03, 0.41, 0.03]}]"


def level(folder, mass=4.0, friction=0.9, more="", can=""):
    """A bar on a table, with a can somewhere (x, y, z) that may be moved."""
    others = CAN.replace("{at}", can) if can else ""
    file = folder / "level.yaml"
    file.write_text(
        LEVEL.format(mass=mass, friction=friction, more=more, others=others, removable="can: {}" if can else "")
    )
    return load_scene(str(file))


@pytest.mark.parametrize("can", ["0.42, 0, 0.09", "0.58, 0.05, 0.04"], ids=["on the bar", "at its goal"])
def test_what_is_in_the_way_of_the_two_arms_is_removed_first(tmp_path, can):
    plan = planner.plan(level(tmp_path, can=can), seed=0)
    first = next(s for s in plan.segments if s.kind != SegmentKind.TRANSIT)
    assert first.object == "can" and plan.stats["removals"] == 1
    assert {s.robot for s in plan.segments if s.object == "bar"} == {"left", "right"}


def test_a_light_bar_that_would_turn_between_the_fingers_is_carried_by_two_arms(tmp_path):
    scene = level(tmp_path, mass=1.6, friction=0.9, more=AT_THE_ENDS)
    ends = scene.bodies["bar"].pose, scene.goal.pose
    grasps = SharedGrasps(scene, scene.start_state(), "bar", ends, np.random.default_rng(0))
    assert not grasps.alone() and grasps.promising()


def test_a_bar_that_slips_out_of_one_gripper_is_held_by_two(tmp_path):
    scene = level(tmp_path, mass=2.9, friction=0.3)  # below the payload of one arm
    ends = scene.bodies["bar"].pose, scene.goal.pose
    grasps = SharedGrasps(scene, scene.start_state(), "bar", ends, np.random.default_rng(0))
    assert not grasps.alone() and grasps.promising()
