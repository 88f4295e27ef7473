"""Paths of objects with sharp corners in narrow places, round which a motion with coarse steps swings too far."""

from hmap_core import planner
from hmap_core.scenes import load_scene
from hmap_core.types import SegmentKind

SLOT = """
schema: 1
description: A block as high as its slot is dragged out of it by its top, and past the corner of the slot's wall.
mode: physical
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.06], pose: {xyz: [0, 0, -0.03]}}
  wall_left: {shape: box, size: [0.1229, 0.06, 0.0339], pose: {xyz: [0.5076, 0.1641, 0.0169]}}
  wall_right: {shape: box, size: [0.1229, 0.06, 0.0339], pose: {xyz: [0.5076, 0.0605, 0.0169]}}
  end: {shape: box, size: [0.02, 0.0435, 0.0339], pose: {xyz: [0.572, 0.1123, 0.0169]}}
movable:
  peg: {shape: box, size: [0.1029, 0.0377, 0.0339], pose: {xyz: [0.5076, 0.1123, 0.0169]}, mass: 0.15, friction: 0.6}
robots:
  panda: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: peg, pose: {xyz: [0.492, -0.1572, 0.0169]}, position_tolerance: 0.01, rotation_tolerance_deg: 2.0}
"""


def test_all_poses_of_a_path_are_steps_where_fewer_cut_a_corner(tmp_path):
    file = tmp_path / "slot.yaml"
    file.write_text(SLOT, encoding="utf-8")
    plan = planner.plan(load_scene(str(file)), seed=43)
    assert [s.kind for s in plan.segments if s.kind != SegmentKind.TRANSIT] == [SegmentKind.PRESS]
    assert plan.stats["contact_tries"] <= 3  # 81 with steps of at least 12 mm
