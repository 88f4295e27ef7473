"""Hand-over: both hands hold the object for a moment."""

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.hand_over import HANDS_APART, meetings
from hmap_core.planner.manipulation_graph.grasp_sets import grasp_sets
from hmap_core.scenes import load_scene
from hmap_core.transforms import multiply
from hmap_core.types import SegmentKind

APART = """
schema: 1
description: A bar is passed on over a gap between two tables, each within reach of one arm.
mode: physical
fixed:
  table_1: {shape: box, size: [0.65, 1.0, 0.05], pose: {xyz: [0.125, 0, -0.025]}}
  table_2: {shape: box, size: [0.65, 1.0, 0.05], pose: {xyz: [1.375, 0, -0.025]}}
movable:
  bar:
    shape: box
    size: [0.26, 0.04, 0.04]
    pose: {xyz: [0.36, 0.05, 0.02], rpy_deg: [0, 0, 80]}
    mass: 0.2
    friction: 0.8
robots:
  left: {model: panda, base: {xyz: [0, 0, 0]}}
  right: {model: panda, base: {xyz: [1.5, 0, 0], rpy_deg: [0, 0, 180]}}
goal: {object: bar, pose: {xyz: [1.12, 0.0, 0.02], rpy_deg: [0, 0, 90]}}
"""


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    file = tmp_path_factory.mktemp("hand_over") / "task.yaml"
    file.write_text(APART)
    return load_scene(str(file))


def test_the_hands_of_a_meeting_are_apart_and_serve_at_both_ends(apart):
    ends = apart.bodies["bar"].pose, apart.goal.pose
    rng = np.random.default_rng(0)
    left, right = grasp_sets(apart, apart.start_state(), "bar", ends, rng)
    assert not (left.serves(ends[0]) & left.serves(ends[1])).any()
    assert next(meetings(apart, ends, right, left, rng), None) is None  # the right arm cannot take the bar up
    found = [meeting for _, meeting in zip(range(5), meetings(apart, ends, left, right, rng), strict=False)]
    assert found
    for meeting in found:
        hands = [
            (from_hulls(load_arm(apart.robots[name].model).hand(c.opening)), multiply(meeting.T, c.T_obj_ee))
            for name, c in ((meeting.giver, meeting.given), (meeting.taker, meeting.taken))
        ]
        (first, T_first), (second, T_second) = hands
        assert set_distance(first, T_first, second, T_second) >= HANDS_APART


def test_a_bar_is_passed_on(apart):
    plan = planner.plan(apart, seed=0)  # the judge has accepted it
    held = {
        name: [(s.start, s.end) for s in plan.segments if s.robot == name and s.kind == SegmentKind.GRASP]
        for name in apart.robots
    }
    gives, takes = held["left"][-1][1], held["right"][0][0]
    assert all(held.values())
    assert takes <= gives  # the second hand holds the bar before the first one lets go
    time, bar = plan.trajectory.time, plan.trajectory.objects["bar"]
    both = (time >= takes) & (time <= gives)
    np.testing.assert_allclose(bar[both], np.tile(bar[both][0], (both.sum(), 1)), atol=1e-9)
    assert bar[both][0][2] > 0.1
