"""Intermediate placements: where an object can lie between two contacts, and the cheapest way over them."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.collision.convex import set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.planner.manipulation_graph import graph as graphs
from hmap_core.planner.manipulation_graph.graph import GOAL, START, ManipulationGraph
from hmap_core.planner.manipulation_graph.grasp_sets import grasp_sets
from hmap_core.planner.manipulation_graph.placements import Placement, intermediate_placements
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy, pose, rotation_matrix
from hmap_core.types import ContactKind, SegmentKind
from hmap_core.waypoints import stable_poses

SLAB = """
schema: 1
description: A slab that is too wide for the gripper lies flat; it is wanted on a post, over whose edge it sticks out.
mode: physical
fixed:
  block: {shape: box, size: [0.4, 0.5, 0.2], pose: {xyz: [0.56, 0, 0.1]}}
  floor: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
  post: {shape: box, size: [0.12, 0.16, 0.32], pose: {xyz: [0.45, 0.42, 0.16]}}
movable:
  slab: {shape: box, size: [0.11, 0.15, 0.022], pose: {xyz: [0.48, 0, 0.211]}, mass: 0.2, friction: 0.5}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: slab, pose: {xyz: [0.43, 0.42, 0.331]}, position_tolerance: 0.02, rotation_tolerance_deg: 10}
"""
CARD = """
schema: 1
description: A card on a slab can be gripped over the edge near the robot only, where the arm follows no path of it.
mode: physical
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
  slab: {shape: box, size: [0.4, 0.48, 0.04], pose: {xyz: [0.57, -0.04, 0.163]}, friction: 0.5}
  foot: {shape: box, size: [0.2, 0.2, 0.143], pose: {xyz: [0.6, -0.04, 0.0715]}}
  pedestal: {shape: box, size: [0.0438, 0.0665, 0.275], pose: {xyz: [0.4483, 0.42, 0.1375]}}
movable:
  card:
    {shape: box, size: [0.0838, 0.1065, 0.0052], pose: {xyz: [0.5026, -0.0595, 0.1856], rpy_deg: [0, 0, -4.3]},
     mass: 0.0685, friction: 0.6}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: card, pose: {xyz: [0.4483, 0.42, 0.2776]}, position_tolerance: 0.015, rotation_tolerance_deg: 8}
"""
UPSIDE_DOWN = """
schema: 1
description: A block is wanted upside down.
mode: physical
motion: spatial
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
movable:
  block: {shape: box, size: [0.05, 0.05, 0.1], pose: {xyz: [0.45, -0.2, 0.05]}, mass: 0.2, friction: 0.7}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: block, pose: {xyz: [0.45, 0.2, 0.05], rpy_deg: [180, 0, 0]}}
"""


def scene_of(text: str, folder):
    file = folder / "task.yaml"
    file.write_text(text)
    return load_scene(str(file))


@pytest.fixture
def slab(tmp_path):
    return scene_of(SLAB, tmp_path)


def placements_of(scene, seed=0) -> list[Placement]:
    goal = scene.goal
    return intermediate_placements(scene, scene.start_state(), goal.object, goal.pose, np.random.default_rng(seed))


def test_placements_are_stable_and_free(slab):
    body, around = slab.bodies["slab"], placed_bodies(slab, slab.start_state(), "slab")
    found = placements_of(slab)
    assert found == sorted(found, key=lambda placement: placement.cost)
    poses = np.array([found[0].pose + LIFT, *(placement.pose for placement in found)])
    assert stable_poses(body, poses, around)[1:].all()
    for placement in found:
        apart = min(set_distance(body_set(body), placement.pose, body_set(b), b.pose) for b in around)
        assert apart >= -1e-6
        np.testing.assert_allclose(placement.up, rotation_matrix(placement.pose)[2], atol=1e-9)


def test_placements_are_on_all_faces_and_over_edges(slab):
    found = placements_of(slab)
    ups = {tuple(np.round(placement.up).astype(int)) for placement in found}
    assert len(ups) == 6
    over = [placement for placement in found if placement.over_edge and abs(placement.pose[2] - 0.211) < 1e-6]
    assert any(placement.pose[0] < 0.36 + 0.03 for placement in over)  # the block ends at x = 0.36
    assert any(placement.slides_to(Placement.at(slab.bodies["slab"].pose)) for placement in over)


def test_the_same_seed_gives_the_same_placements(slab):
    first, second = ([placement.pose for placement in placements_of(slab)] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_sliding_keeps_height_and_tilt():
    flat, moved = Placement.at(pose((0.4, 0.0, 0.1))), Placement.at(from_rpy((0.5, 0.1, 0.1), (0.0, 0.0, 1.0)))
    assert flat.slides_to(moved)
    assert not flat.slides_to(Placement.at(pose((0.4, 0.0, 0.2))))
    assert not flat.slides_to(Placement.at(from_rpy((0.4, 0.0, 0.1), (np.pi, 0.0, 0.0))))


def test_no_grasp_serves_a_flat_slab_but_some_do_at_the_goal(slab):
    ends = slab.bodies["slab"].pose, slab.goal.pose
    (grasps,) = grasp_sets(slab, slab.start_state(), "slab", ends, np.random.default_rng(0))
    assert not grasps.serves(ends[0]).any()
    assert grasps.serves(ends[1]).any()
    assert all(contact.kind == ContactKind.GRASP for contact in grasps.contacts)


# --- the graph, with edges that are given


class Grasps:
    """Grasps of which each serves at some nodes; the node's number is its x."""

    robot = "arm"

    def __init__(self, *served: set[int], reached: bool = True):
        self._served, self._reached = served, reached

    def serves(self, T):
        return np.array([round(T[0]) in nodes for nodes in self._served])

    def within_reach(self, T):
        return 1

    def hands(self, T_from, T_to, count, rng):
        return [f"{T_from[0]:g}-{T_to[0]:g}"] if self._reached else []


def graph_of(*grasps: Grasps, heights=(0.0,) * 5) -> ManipulationGraph:
    nodes = [Placement.at(pose((float(k), 0.0, z))) for k, z in enumerate(heights)]
    return ManipulationGraph(nodes, list(grasps), SimpleNamespace(motions=()), np.random.default_rng(0))


APART = (0.0, 1.0, 2.0, 3.0, 4.0)


def test_one_grasp_is_the_cheapest_way():
    graph = graph_of(Grasps({0, 1, 2}), heights=APART)
    assert graph.cheapest() == [START, GOAL]
    assert graph.edge(START, GOAL).hands == [("arm", "0-1")]


def test_two_grasps_meet_at_a_placement():
    graph = graph_of(Grasps({0, 3}, {3, 1}), heights=APART)
    assert graph.cheapest() == [START, 3, GOAL]


def test_a_push_precedes_a_grasp():
    graph = graph_of(Grasps({2, 1}), heights=(0.0, 1.0, 0.0, 0.0, 0.0))
    assert graph.cheapest() == [START, 2, GOAL]
    assert graph.edge(START, 2).sliding and not graph.edge(2, GOAL).sliding


def test_there_may_be_no_way():
    assert graph_of(Grasps({0, 3}, {4, 1}), heights=APART).cheapest() is None
    assert graph_of(Grasps({0, 1}, reached=False), heights=APART).cheapest() is None


def test_a_push_all_the_way_was_tried_before():
    assert graph_of(Grasps({2}), heights=(0.0, 0.0, 1.0, 2.0, 3.0)).cheapest() is None


def test_no_pushes_from_where_none_could_be_planned():
    graph = graph_of(Grasps({1, 2, 3, 4, 5, 6}), heights=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    tried = []
    while (way := graph.cheapest()) is not None:
        tried.append(way[1])
        graph.failed(way[0], way[1])
    assert len(tried) == graphs.SLIDES_TRIED


def test_a_failed_edge_is_priced_and_given_up_at_last():
    graph = graph_of(Grasps({0, 3, 4}, {3, 4, 1}), heights=APART)
    ways = []
    while (way := graph.cheapest()) is not None:
        ways.append(tuple(way))
        graph.failed(way[0], way[1])
    assert len(set(ways[:2])) == 2  # the other placement comes before a second try
    assert all(ways.count(way) == graphs.TRIES for way in set(ways) if len(way) == 3)


def test_a_way_goes_on_from_where_the_object_was_brought():
    graph = graph_of(Grasps({0, 3, 4}, {3, 4, 1}), heights=APART)
    first = graph.cheapest()[1]
    graph.solved(START, first, SimpleNamespace(motions=(1,)))
    assert graph.cheapest() == [first, GOAL]


# --- whole tasks


def test_a_slab_is_slid_over_an_edge_and_gripped_there(slab):
    plan = planner.plan(slab, seed=0)  # the judge has accepted it
    kinds = [segment.kind for segment in plan.segments if segment.kind != SegmentKind.TRANSIT]
    assert kinds[0] in (SegmentKind.PUSH, SegmentKind.PRESS) and kinds[-1] == SegmentKind.GRASP


def test_a_block_is_turned_upside_down(tmp_path):
    plan = planner.plan(scene_of(UPSIDE_DOWN, tmp_path), seed=0)
    end = plan.trajectory.objects["block"][-1]
    assert rotation_matrix(end)[2, 2] == pytest.approx(-1.0, abs=1e-3)


def test_what_no_arm_carries_along_a_path_is_moved_by_a_search_over_the_joints(tmp_path):
    plan = planner.plan(scene_of(CARD, tmp_path), seed=10)
    kinds = [segment.kind for segment in plan.segments if segment.kind != SegmentKind.TRANSIT]
    assert kinds[0] == SegmentKind.PRESS and SegmentKind.GRASP in kinds
    assert "picks and places 'card'" in str(plan.stats["search"])
