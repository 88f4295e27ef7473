"""Contacts in narrow places, which few of thousands fit: what the hand alone can make, also drawn back a little."""

from dataclasses import replace

import numpy as np
import pytest

from hmap_core.contacts.candidates import SHALLOWEST
from hmap_core.contacts.hand import LEAST_BACK, drawn_back
from hmap_core.exceptions import Code, ContactError
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.diagnosis import hand_fits_at_goal
from hmap_core.planner.obstacle_removal import _Tries
from hmap_core.planner.outcome import Failure
from hmap_core.planner.protocols import ContactProposals, ContactQuery, ContactSearchQuery
from hmap_core.planner.sampled_contacts import SampledContacts, first_direction
from hmap_core.planner.solution_sequence import Subgoal
from hmap_core.planner.tool_grasps import ToolGraspSearch
from hmap_core.scenes import load_scene
from hmap_core.scenes.robots import load_robot_model
from hmap_core.transforms import apply, inverse, pose
from hmap_core.types import ContactKind, ContactPoint, Goal

NICHE = """
schema: 1
description: A can into a niche that is as wide as the hand; its palm stays outside.
mode: physical
fixed:
  table: {{shape: box, size: [2.4, 2.4, 0.06], pose: {{xyz: [0, 0, -0.03]}}}}
  niche:
    pose: {{xyz: [0.62, 0.2, 0.15]}}
    parts:
      - {{shape: box, size: [0.2, 0.24, 0.02], pose: {{xyz: [0, 0, -0.01]}}}}
      - {{shape: box, size: [0.2, 0.24, 0.02], pose: {{xyz: [0, 0, 0.23]}}}}
      - {{shape: box, size: [0.2, 0.02, 0.22], pose: {{xyz: [0, 0.11, 0.11]}}}}
      - {{shape: box, size: [0.2, 0.02, 0.22], pose: {{xyz: [0, -0.11, 0.11]}}}}
      - {{shape: box, size: [0.02, 0.24, 0.26], pose: {{xyz: [0.11, 0, 0.11]}}}}
movable:
  can: {{shape: cylinder, size: [0.03, 0.11], pose: {{xyz: [0.45, -0.15, 0.055]}}, mass: 0.2}}
robots:
  arm: {{model: fr3, base: {{xyz: [0, 0, 0]}}}}
goal: {{object: can, pose: {{xyz: [{x}, 0.2, 0.205]}}, rotation_tolerance_deg: 180}}
"""
HOLDER = """
schema: 1
description: A stick that stands in a holder pushes a die through a tunnel.
mode: physical
motion: planar
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.06], pose: {xyz: [0, 0, -0.03]}}
  tunnel:
    pose: {xyz: [0.57, 0, 0]}
    parts:
      - {shape: box, size: [0.24, 0.02, 0.07], pose: {xyz: [0, 0.045, 0.035]}}
      - {shape: box, size: [0.24, 0.02, 0.07], pose: {xyz: [0, -0.045, 0.035]}}
      - {shape: box, size: [0.24, 0.11, 0.02], pose: {xyz: [0, 0, 0.08]}}
  holder:
    pose: {xyz: [0.3, -0.35, 0]}
    parts:
      - {shape: box, size: [0.06, 0.015, 0.06], pose: {xyz: [0, 0.0205, 0.03]}}
      - {shape: box, size: [0.06, 0.015, 0.06], pose: {xyz: [0, -0.0205, 0.03]}}
      - {shape: box, size: [0.015, 0.026, 0.06], pose: {xyz: [0.0205, 0, 0.03]}}
      - {shape: box, size: [0.015, 0.026, 0.06], pose: {xyz: [-0.0205, 0, 0.03]}}
movable:
  die: {shape: box, size: [0.05, 0.05, 0.05], pose: {xyz: [0.48, 0, 0.025]}, mass: 0.1, friction: 0.4}
tools:
  stick: {shape: box, size: [0.022, 0.022, 0.32], pose: {xyz: [0.3, -0.35, 0.16]}, mass: 0.12, friction: 0.9}
robots:
  arm: {model: ur5e_2f85, base: {xyz: [0, 0, 0]}}
goal: {object: die, pose: {xyz: [0.62, 0, 0.025]}}
"""


def scene_of(folder, text):
    file = folder / "task.yaml"
    file.write_text(text)
    return load_scene(str(file))


@pytest.mark.parametrize(("x", "fits"), [(0.553, True), (0.64, False)])
def test_a_goal_counts_as_out_of_reach_only_if_drawn_back_hands_do_not_fit_either(tmp_path, x, fits):
    scene = scene_of(tmp_path, NICHE.format(x=x))
    assert hand_fits_at_goal(scene, scene.start_state(), "can", scene.goal.pose) == fits


def test_a_tool_is_not_given_up_for_its_best_contacts(tmp_path):
    scene = scene_of(tmp_path, HOLDER)
    state = scene.start_state()
    path = np.linspace(state.poses["die"], scene.goal.pose, 14)
    found = ToolGraspSearch(SampledContacts()).tool_grasps(scene, state, "die", path, 0, 60.0)
    assert found and all(reach > 0 for _, reach in found)


def test_drawn_back_grasps_have_less_of_the_pads_on_the_object():
    gripper = load_robot_model("fr3").require_gripper()
    turned = np.array([0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5])
    forward, side = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    most = SHALLOWEST * gripper.tip_offset

    def grasp(depth):
        return ContactPoint(ContactKind.GRASP, turned, apply(turned, np.array([0.0, 0.02, depth])), side, 0.04, forward)

    deep, shallow = grasp(0.0), grasp(most - 0.5 * LEAST_BACK)
    (moved,) = drawn_back([deep, shallow], gripper)
    assert apply(inverse(moved.T_obj_ee), deep.point) == pytest.approx([0.0, 0.02, most])
    np.testing.assert_array_equal(moved.point, deep.point)
    assert drawn_back([], gripper) == []


def test_contacts_of_the_hand_alone_are_found_once_for_a_place(tmp_path, monkeypatch):
    """Whatever the seed, the place to which the object goes, and where its arm is; not where it stands elsewhere."""
    scene = scene_of(tmp_path, NICHE.format(x=0.6))
    looked, look = [], SampledContacts._looked_through

    def counted(self, query, *rest):
        looked.append(query)
        return look(self, query, *rest)

    monkeypatch.setattr(SampledContacts, "_looked_through", counted)

    def last(seed, turn, at, to):
        state = scene.start_state()
        state.q["arm"] = state.q["arm"] + turn
        state.poses["can"] = at
        path = np.linspace(at, to, 30)
        query = ContactQuery(replace(scene, motion="spatial"), state, "can", path, "arm", np.random.default_rng(seed))
        return [contact.T_obj_ee.tolist() for contact in list(SampledContacts().propose(query))[-1].contacts]

    goal = scene.goal.pose
    above, higher = goal + np.r_[0.0, 0.0, 0.05, np.zeros(4)], goal + np.r_[0.0, 0.0, 0.08, np.zeros(4)]
    first = last(1, 0.0, goal, above)
    assert last(2, 0.1, goal, higher) == first and len(looked) == 1
    last(1, 0.0, goal + np.r_[-0.01, np.zeros(6)], above)
    assert len(looked) == 2


def test_the_first_direction_of_a_path():
    start = np.array([0.3, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])

    def along(*way):
        return np.array([start, start + np.r_[way, np.zeros(4)]])

    np.testing.assert_array_equal(first_direction(along(0.002, 0.0, 0.01)), (0.0, 0.0, 1.0))
    np.testing.assert_array_equal(first_direction(along(-0.01, 0.006, 0.0)), (-1.0, 1.0, 0.0))
    np.testing.assert_array_equal(first_direction(start[None]), np.zeros(3))
    np.testing.assert_array_equal(first_direction(along(0.0, 0.0, 0.0)), np.zeros(3))
    turned = along(0.01, 0.0, 0.0)
    turned[1, 3:] = np.array([0.0, 0.0, np.sin(0.1), np.cos(0.1)])
    assert first_direction(turned) is None


def test_places_at_another_height_come_first_where_two_at_one_had_no_contact():
    class Nowhere:
        context = None

        def bring(self, subgoal, sequence):
            return Failure.of(ContactError("no contact", Code.NO_CONTACT))

    class Untested(_Tries):
        def _check_immovable(self, name):
            pass

    tries = Untested(Nowhere(), None)
    places = [np.array([x, 0.0, z, 0.0, 0.0, 0.0, 1.0]) for x, z in enumerate((0.25, 0.25, 0.25, 0.25, 0.5, 0.05))]
    tried = []
    for T in tries.varied(places):
        tried.append(int(T[0]))
        tries.first(Subgoal(Goal("jar", T), frozenset(), ()), [T])
    assert tried == [0, 1, 4, 5, 2, 3]


@pytest.mark.parametrize("late", [0, 3])
def test_a_search_says_whether_hands_fit_on_the_object(tmp_path, late):
    """What comes after an empty batch are those of thousands that the hand alone can make; here no arm reaches one."""
    scene = scene_of(tmp_path, NICHE.format(x=0.55))
    point = ContactPoint(ContactKind.PUSH, pose(), np.zeros(3), np.zeros(3), 0.0, np.array([0.0, 0.0, 1.0]))
    looked = []

    class Scripted:
        def propose(self, query):
            yield from (ContactProposals((point,)), ContactProposals(()))
            if late:
                yield ContactProposals((point,) * late)

        def check(self, query, contacts, beyond):
            looked.append(len(contacts))
            return []

    query = ContactSearchQuery(scene, scene.start_state(), "can", scene.start_state().poses["can"][None])
    for thorough in (True, False):
        with pytest.raises(ContactError) as error:
            ProposeAndCheck([Scripted()], Scripted()).find_contacts(replace(query, thorough=thorough))
        assert error.value.nothing_fits is (thorough and not late)
    assert looked == [1, *[late] * bool(late), 1]
