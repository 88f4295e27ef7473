"""Paths of two pushes, along arcs, to a goal whose orientation is open."""

import numpy as np
import pytest
from geometry_fixtures import TABLE, box, yaw
from push_fixtures import CRATE, assert_can_be_pushed

from hmap_core.contacts.few_pushes import two_pushes
from hmap_core.contacts.push_path import PushPlanner, planar_yaw
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.scenes import load_scene
from hmap_core.transforms import distance, pose
from hmap_core.waypoints import ObjectPathProblem

Z = 0.09  # of a crate on the table
QUARTER = 0.5 * np.pi
BLOCK = box("block", (0.1, 0.2, 0.1), (0.25, -0.05, 0.1))


def at(x: float, y: float, turn: float = 0.0) -> np.ndarray:
    return pose((x, y, Z), yaw(np.deg2rad(turn)))


def ends(planner: PushPlanner) -> np.ndarray:
    return np.array([planner.problem.start, planner.problem.goal])


def turns(path: np.ndarray) -> int:
    """How often the direction of a path jumps; along an arc it does not."""
    steps = np.diff(path[:, :2], axis=0)
    return int((np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))) > np.deg2rad(8.0)).sum())


@pytest.mark.parametrize("seed", range(3))
def test_round_a_corner_with_two_pushes_where_straight_ones_are_three(seed):
    scene = load_scene("puck_around", seed)
    start = scene.start_state()
    way = np.array([start.poses["puck"], scene.goal.pose])
    planner = push_planner(scene, start, "puck", way)
    path = two_pushes(planner, way, scene.goal.pose, QUARTER)
    assert turns(path) == 1
    assert all(planner.checker.motion_free(a, b) for a, b in zip(path, path[1:], strict=False))
    assert_can_be_pushed(path, scene.bodies["puck"])
    off, turned = distance(path[-1], scene.goal.pose)
    assert off < 1e-9 and np.deg2rad(20.0) < turned <= QUARTER + 1e-6
    np.testing.assert_array_equal(path[0], start.poses["puck"])
    np.testing.assert_array_equal(path, two_pushes(planner, way, scene.goal.pose, QUARTER))


@pytest.mark.parametrize("turn", [0.0, 0.2, QUARTER])
def test_the_object_is_turned_at_the_end_by_no_more_than_is_allowed(turn):
    task = ObjectPathProblem(CRATE, at(0.0, 0.0), at(0.5, 0.0), (TABLE, BLOCK), motion="planar")
    planner = PushPlanner(task)
    path = two_pushes(planner, ends(planner), task.goal, turn)
    if path is None:
        assert turn < QUARTER
        return
    assert_can_be_pushed(path)
    assert abs(planar_yaw(task.goal, path[-1])) <= turn + 2e-3
    np.testing.assert_allclose(path[-1][:3], task.goal[:3], atol=1e-9)


def test_there_is_none_where_the_way_is_closed():
    wall = box("wall", (0.05, 3.0, 0.1), (0.25, 0.0, 0.1))
    planner = PushPlanner(ObjectPathProblem(CRATE, at(0.0, 0.0), at(0.5, 0.0), (TABLE, wall), motion="planar"))
    assert two_pushes(planner, ends(planner), planner.problem.goal, QUARTER) is None
