"""Tools: chosen by the planner, picked, used and placed; and arms with attached bodies."""

from dataclasses import replace

import numpy as np
import pytest
from tool_fixtures import push_out

from hmap_core.benchmark.quality import quality
from hmap_core.exceptions import HmapError
from hmap_core.kinematics.arm import load_arm
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan
from hmap_core.planner.segments import attach_body
from hmap_core.planner.tools import farthest_points
from hmap_core.scenes import load_scene
from hmap_core.scenes.portable import scene_from_text, scene_to_text
from hmap_core.transforms import apply, multiply, pose, rotation_matrix
from hmap_core.types import ContactKind, ContactPoint, SegmentKind
from hmap_core.validation import check

FORWARD = np.array([0.0, 0.0, 1.0])


def hold(T_obj_ee) -> ContactPoint:
    return ContactPoint(ContactKind.GRASP, T_obj_ee, np.zeros(3), np.array([0, 1.0, 0]), 0.04, FORWARD)


@pytest.mark.parametrize("mode", ["physical", "kinematic"])
def test_the_tool_that_reaches_is_picked_used_and_placed(tmp_path, mode):
    scene = push_out(tmp_path, mode)
    found = plan(scene, seed=1)
    assert check(to_dict(found)).valid
    used = [s for s in found.segments if s.manipulator == "stick"]
    assert used and all(s.object == "crate" for s in used)
    assert not any("cube" in (s.manipulator, s.object) for s in found.segments)
    way = found.trajectory.objects["stick"]
    assert np.abs(way - way[0]).max() > 0.1
    assert ((way[1:, 3:] * way[:-1, 3:]).sum(axis=1) > 0.0).all()  # no sign of a quaternion flips
    np.testing.assert_allclose(way[-1], way[0], atol=1e-3)


def test_only_tools_are_worked_with(tmp_path):
    with pytest.raises(HmapError):
        plan(push_out(tmp_path, kind="movable"), seed=1)


def test_the_same_seed_takes_the_same_tool_the_same_way(tmp_path):
    scene = push_out(tmp_path)
    first, second = (plan(scene, seed=2) for _ in range(2))
    np.testing.assert_array_equal(first.trajectory.joints["arm"], second.trajectory.joints["arm"])


def test_a_tool_is_grasped_where_it_need_not_be_turned_round():
    # the stick lies behind the bar already; grasped at its other half, it would have to come with its other end
    found = plan(load_scene("tunnel_tool", seed=0), seed=0)
    assert quality(found).tool_swing < 2.0
    moved = found.trajectory.objects["stick"]
    turned = 2.0 * np.arccos(np.clip(np.abs(moved[:, 3:] @ moved[0, 3:]), 0.0, 1.0))
    assert turned.max() < np.deg2rad(45.0)


def test_the_arm_does_not_swing_between_two_contacts_of_a_tool():
    found = plan(load_scene("puck_around", seed=1), seed=1)
    measured = quality(found)
    assert measured.tool_swing < 2.0 and measured.episodes == 3
    grasp = next(segment for segment in found.segments if segment.object == "pawn")
    hand = rotation_matrix(found.scene.bodies["pawn"].pose) @ rotation_matrix(grasp.contact_pose)
    assert hand[2, 2] < -0.7  # from above: the last joint alone turns the tool about the vertical


def test_what_is_held_rests_in_the_grip_while_it_is_worked_with(tmp_path):
    found = plan(push_out(tmp_path), seed=1)
    arm, robot = load_arm(found.scene.robots["arm"].model), found.scene.robots["arm"]
    holds = [s for s in found.segments if "stick" in (s.manipulator, s.object) and s.kind != SegmentKind.TRANSIT]
    start, end = min(s.start for s in holds), max(s.end for s in holds)
    time = found.trajectory.time
    rows = (time >= start) & (time <= end)
    T_ee = np.array([multiply(robot.base_pose, T) for T in arm.end_effectors(found.trajectory.joints["arm"][rows])])
    corner = np.array([0.2, 0.0, 0.0])
    sticks = found.trajectory.objects["stick"][rows]
    distance_to_hand = [np.linalg.norm(apply(stick, corner) - T[:3]) for T, stick in zip(T_ee, sticks, strict=True)]
    assert np.ptp(distance_to_hand) < 1e-5


def test_an_arm_that_holds_a_body_touches_with_it(tmp_path):
    scene = push_out(tmp_path)
    T_hold = pose((0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    attached = attach_body(scene, "arm", "stick", hold(T_hold), scene.bodies["stick"].pose)
    assert "stick" not in attached.bodies
    model = attached.robots["arm"].model
    bare, arm = load_arm(replace(model, attached=None)), load_arm(model)
    assert load_arm(model) is arm
    assert [h.link for h in arm.hulls if h.finger] == ["stick"]
    assert len(arm.hulls) == len(bare.hulls) + 1
    corners = apply(T_hold, arm.finger_vertices(0.0))
    np.testing.assert_allclose(np.abs(corners), np.tile([0.2, 0.02, 0.02], (8, 1)), atol=1e-9)


def test_a_scene_with_a_held_body_crosses_a_network(tmp_path):
    scene = push_out(tmp_path)
    T_hold = pose((0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    attached = attach_body(scene, "arm", "stick", hold(T_hold), scene.bodies["stick"].pose)
    before, after = (s.robots["arm"].model.attached for s in (attached, scene_from_text(scene_to_text(attached))))
    assert (after.name, after.opening, after.friction) == (before.name, before.opening, before.friction)
    np.testing.assert_allclose(after.T_ee_body, before.T_ee_body, atol=1e-9)
    assert [s.size for s in after.shapes] == [s.size for s in before.shapes]
    assert scene_from_text(scene_to_text(scene)).robots["arm"].model.attached is None


def test_holds_are_spread_over_a_tool():
    contacts = [hold(pose((x, 0.0, 0.0))) for x in (0.0, 0.01, 0.02, 0.19, 0.2)]
    assert farthest_points(contacts, 2) == [0, 4]
    assert sorted(farthest_points(contacts, 9)) == [0, 1, 2, 3, 4]
    assert farthest_points([], 3) == []
