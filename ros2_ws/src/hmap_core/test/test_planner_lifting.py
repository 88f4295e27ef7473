"""An object that would tip between the fingers when dragged over its support is lifted."""

import numpy as np
import pytest

from hmap_core.collision.convex import set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.planner import ContactSearchQuery, SegmentQuery, local_components
from hmap_core.planner.lifting import LIFT, ROOM, crosses, drag_tips, lifted, raised
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy, interpolate, pose
from hmap_core.types import ContactKind, ContactPoint

SCENE = """
schema: 1
description: A tall box beside the robot.
mode: physical
fixed:
  table: {{shape: box, size: [2, 2, 0.1], pose: {{xyz: [0, 0, -0.05]}}}}
  roof: {{shape: box, size: [0.6, 0.6, 0.02], pose: {{xyz: [0.5, 0.0, {roof}]}}}}
movable:
  tall: {{shape: box, size: [0.03, 0.06, 0.20], pose: {{xyz: [0.45, -0.1, 0.1]}}, mass: 0.2, friction: 0.6}}
robots:
  arm: {{model: panda, base: {{xyz: [0, 0, 0]}}}}
goal: {{object: tall, pose: {{xyz: [0.55, -0.1, 0.1]}}}}
"""


def task(folder, roof=0.9):
    file = folder / f"tall_{roof}.yaml"
    file.write_text(SCENE.format(roof=roof))
    return load_scene(str(file))


def grasp(height, turn=0.0):
    """From above in the body's frame, closing along y, or along x with a quarter turn."""
    T = from_rpy((0.0, 0.0, height), (np.pi, 0.0, turn))
    return ContactPoint(ContactKind.GRASP, T, T[:3], np.array([0.0, 1.0, 0.0]), 0.06, np.array([0.0, 0.0, 1.0]))


def path(scene):
    return interpolate(scene.bodies["tall"].pose, scene.goal.pose, np.linspace(0.0, 1.0, 11))


@pytest.mark.parametrize(
    ("height", "turn", "tips"),
    [
        (0.0, 0.0, True),  # 0.6 * 10 cm against 1.5 cm
        (-0.08, 0.0, False),  # 0.6 * 2 cm against 1.5 cm
        (0.0, np.pi / 2, False),  # the fingers are on the faces before and behind
    ],
)
def test_what_tips_depends_on_the_height_of_the_grip(tmp_path, height, turn, tips):
    scene = task(tmp_path)
    assert drag_tips(scene.bodies["tall"], grasp(height, turn), path(scene)) == tips


def test_what_rises_by_itself_does_not_tip(tmp_path):
    scene = task(tmp_path)
    poses = path(scene)
    poses[:, 2] += np.linspace(0.0, 0.2, len(poses))
    assert not drag_tips(scene.bodies["tall"], grasp(0.0), poses)


def test_raising_leaves_the_ends_and_what_is_high_enough():
    poses = np.tile(pose((0.0, 0.0, 0.1)), (7, 1))
    poses[3, 2] = 0.3
    once = raised(poses, 3, 3)
    np.testing.assert_allclose(once[:, 2] - 0.1, [0.0, LIFT, LIFT, 0.2, LIFT, LIFT, 0.0])
    np.testing.assert_allclose(raised(once, 3, 3), once)


def test_a_way_that_comes_from_below_is_raised_without_a_leap():
    heights = np.array([0.1, 0.11, 0.15, 0.17, 0.185, 0.2, 0.2, 0.2])
    poses = np.array([pose((0.01 * k, 0.0, z)) for k, z in enumerate(heights)])
    eased = heights + LIFT * np.array([0.0, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(raised(poses, 0, 3)[:, 2], eased)
    np.testing.assert_allclose(raised(poses[::-1], 3, 0)[::-1, 2], eased)


def contact_on(scene, poses):
    """A contact of the arm that would be dragged and tip; which one the sampling finds is the same every time."""
    state = scene.start_state()
    found = local_components().contacts.find_contacts(ContactSearchQuery(scene, state, "tall", poses))
    return next(c for c in found if c.reach == len(poses) - 1 and drag_tips(scene.bodies["tall"], c.contact, poses))


def test_there_is_room_to_lift_it_or_not(tmp_path):
    scene = task(tmp_path)
    poses, state = path(scene), scene.start_state()
    contact = contact_on(scene, poses)
    around = placed_bodies(scene, state, "tall")
    higher, way = lifted(scene, state, "tall", contact, poses, around, 0.7)
    np.testing.assert_allclose(way[1:-1, 2], 0.1 + LIFT)
    np.testing.assert_allclose(way[[0, -1]], poses[[0, -1]])
    assert higher.keyframes.shape == contact.keyframes.shape
    assert np.abs(higher.keyframes[5] - contact.keyframes[5]).max() > 1e-3

    low = task(tmp_path, roof=0.218)  # 8 mm over it
    under = placed_bodies(low, low.start_state(), "tall")
    kept, way = lifted(low, low.start_state(), "tall", contact, poses, under, 0.7)
    assert kept is contact
    assert way is poses

    heavy, way = lifted(scene, state, "tall", contact, poses, around, -1.0)  # as if the pads held nothing
    assert heavy is contact
    assert way is poses


def test_a_segment_of_the_planner_lifts_what_would_tip(tmp_path):
    scene = task(tmp_path)
    poses, state = path(scene), scene.start_state()
    contact = contact_on(scene, poses)
    motion = local_components().segments.plan_segment(SegmentQuery(scene, state, "tall", contact, poses))
    assert motion.trajectory.objects["tall"][:, 2].max() == pytest.approx(0.1 + LIFT, abs=2e-3)


def test_an_object_whose_path_rises_is_placed_from_above(tmp_path):
    """Gripped before and behind it would not tip; but as its way rises, it does not come along the table."""
    scene = task(tmp_path)
    state, poses = scene.start_state(), path(scene)
    poses[3:6, 2] += 0.05
    found = local_components().contacts.find_contacts(ContactSearchQuery(scene, state, "tall", poses))
    contact = next(c for c in found if c.reach == len(poses) - 1 and c.contact.kind == ContactKind.GRASP)
    _, way = lifted(scene, state, "tall", contact, poses, placed_bodies(scene, state, "tall"), 0.7)
    np.testing.assert_allclose(way[[1, 2, 6, 7, 8, 9], 2], 0.1 + LIFT)
    np.testing.assert_allclose(way[[0, 3, 4, 5, 10]], poses[[0, 3, 4, 5, 10]])


@pytest.mark.parametrize(
    ("gap", "top", "crossing"),
    [
        (0.1, 0.0, True),
        (0.0, 0.0, True),  # they meet: their heights may differ by a little
        (0.1, -0.02, False),  # it flies anyway, or falls
        (None, 0.0, False),  # one stand only
    ],
)
def test_a_level_path_from_one_support_to_another_crosses_an_edge(tmp_path, gap, top, crossing):
    """Two stands beside each other: dragged level, the object would run into the edge of the second one."""
    scene = stands(tmp_path, gap, top)
    poses = path(scene)
    assert crosses(scene.bodies["tall"], poses, placed_bodies(scene, scene.start_state(), "tall")) == crossing


def test_what_crosses_an_edge_is_lifted_over_it(tmp_path):
    scene = stands(tmp_path, 0.1, 0.0)
    state, poses = scene.start_state(), path(scene)
    found = local_components().contacts.find_contacts(ContactSearchQuery(scene, state, "tall", poses))
    contact = next(
        c for c in found if c.reach == len(poses) - 1 and not drag_tips(scene.bodies["tall"], c.contact, poses)
    )
    _, way = lifted(scene, state, "tall", contact, poses, placed_bodies(scene, state, "tall"), 0.7)
    np.testing.assert_allclose(way[1:-1, 2], poses[0, 2] + LIFT)


def stands(folder, gap, top):
    """The task on a stand, and its goal on another one, ``gap`` metres apart and ``top`` metres higher."""
    size = 0.4 if gap is None else 0.2 - gap
    first = f"  first: {{{{shape: box, size: [{size}, 0.3, 0.1], pose: {{{{xyz: [0.45, -0.1, 0.05]}}}}}}}}\n"
    second = f"  second: {{{{shape: box, size: [{size}, 0.3, 0.1], pose: {{{{xyz: [0.65, -0.1, {0.05 + top}]}}}}}}}}\n"
    text = SCENE.replace("movable:", first + ("" if gap is None else second) + "movable:")
    text = text.replace("size: [0.03, 0.06, 0.20]", "size: [0.06, 0.05, 0.06]")
    text = text.format(roof=0.9).replace("[0.45, -0.1, 0.1]}, mass", "[0.45, -0.1, 0.13]}, mass")
    file = folder / "stands.yaml"
    file.write_text(text.replace("[0.55, -0.1, 0.1]", f"[{0.62 if gap is None else 0.65}, -0.1, 0.13]"))
    return load_scene(str(file))


def test_an_object_passes_over_the_edge_of_its_next_support_with_room(tmp_path):
    """Objects sag between the pads; a path of the object alone passes 2 mm from the edge of a body that it touches."""
    step = "  step: {{shape: box, size: [0.1, 0.3, 0.05], pose: {{xyz: [0.62, -0.1, 0.025]}}}}\nmovable:"
    text = SCENE.replace("movable:", step).format(roof=0.9).replace("[0.55, -0.1, 0.1]", "[0.62, -0.1, 0.15]")
    (tmp_path / "step.yaml").write_text(text)
    scene = load_scene(str(tmp_path / "step.yaml"))
    state, start, goal = scene.start_state(), scene.bodies["tall"].pose, scene.goal.pose
    over = interpolate(start, goal, np.linspace(0.0, 1.0, 41))
    ahead = over[1:-1, 0] + 0.015 - 0.57  # of its leading edge, from the edge of the step
    over[1:-1, 2] = 0.1 + np.clip(0.054 + ahead, 0.0, 0.065)  # rises obliquely, 3 mm from there
    found = local_components().contacts.find_contacts(ContactSearchQuery(scene, state, "tall", over))
    contact = next(c for c in found if c.reach == len(over) - 1 and c.contact.kind == ContactKind.GRASP)
    _, way = lifted(scene, state, "tall", contact, over, placed_bodies(scene, state, "tall"), 0.7)

    def nearest(poses):
        own, edge = body_set(scene.bodies["tall"]), body_set(scene.bodies["step"])
        return min(set_distance(own, T, edge, scene.bodies["step"].pose) for T in poses[:-4])

    assert nearest(over) < ROOM < nearest(way)
    np.testing.assert_allclose(way[[0, -1]], over[[0, -1]])
