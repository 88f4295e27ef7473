"""Object paths made of pushes: each leg can be pushed on one side, and the whole is free."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_fixtures import TABLE, box, yaw
from push_fixtures import CRATE, assert_can_be_pushed

from hmap_core.contacts.push import SlidingBody
from hmap_core.contacts.push_path import PushPlanner, final_pushes, first_pushes, sides
from hmap_core.planner.components import local_components
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.scenes import load_scene
from hmap_core.transforms import distance, interpolate, pose
from hmap_core.types import Shape, ShapeKind
from hmap_core.waypoints import ObjectPathProblem, plan_waypoints
from hmap_core.waypoints.checker import Geometry, ObjectChecker

Z = 0.09  # of a crate on the table
WALL = box("wall", (0.2, 0.02, 0.1), (0.0, 0.0, 0.1))


def at(x, y, turn=0.0):
    return pose((x, y, Z), yaw(np.deg2rad(turn)))


def problem(start, goal, *obstacles, body=CRATE):
    return ObjectPathProblem(body, start, goal, (TABLE, *obstacles), motion="planar")


def straight(problem):
    return interpolate(problem.start, problem.goal, np.linspace(0.0, 1.0, 31))


def assert_free(problem, path):
    checker = ObjectChecker(problem, Geometry(problem), True, 0.0)
    assert all(checker.motion_free(a, b) for a, b in zip(path, path[1:], strict=False))
    np.testing.assert_allclose(path[[0, -1]], [problem.start, problem.goal], atol=1e-9)
    steps = [distance(a, b) for a, b in zip(path, path[1:], strict=False)]
    assert max(d for d, _ in steps) < 0.011 and max(a for _, a in steps) < np.deg2rad(3.1)


def directions(path):
    """Directions of a path's steps in degrees, without turns in place."""
    steps = np.diff(path[:, :2], axis=0)
    steps = steps[np.hypot(*steps.T) > 0.002]
    return np.rad2deg(np.arctan2(steps[:, 1], steps[:, 0]))


def test_a_crate_has_four_sides_and_turns_more_the_farther_from_its_middle_it_is_pushed():
    found = sides(CRATE, SlidingBody(CRATE, at(0, 0, 30)))
    headings = np.sort(np.rad2deg([side.heading for side in found]))
    np.testing.assert_allclose(headings, [-150, -60, 30, 120], atol=1e-3)
    length = SlidingBody(CRATE, at(0, 0)).length
    for side in found:
        np.testing.assert_allclose(side.curvature, np.array([-0.05, 0.05]) / length**2, rtol=0.05)


@pytest.mark.parametrize("goal", [at(0.3, 0.0), at(0.2, 0.15), at(-0.1, 0.25), at(0.3, 0.1, 40), at(-0.2, -0.2, -100)])
def test_any_pose_is_reached_by_pushes(goal):
    task = problem(at(0, 0), goal)
    path = PushPlanner(task).path(straight(task), None)
    assert_free(task, path)
    assert_can_be_pushed(path)


def test_straight_along_a_normal_is_one_push():
    task = problem(at(0, 0, 25), at(0.2 * np.cos(np.deg2rad(25)), 0.2 * np.sin(np.deg2rad(25)), 25))
    path = PushPlanner(task).path(straight(task), None)
    assert len(path) == 21
    np.testing.assert_allclose(path, interpolate(task.start, task.goal, np.linspace(0, 1, 21)), atol=1e-9)


def test_round_a_wall():
    task = problem(at(0.0, -0.15), at(0.0, 0.15), WALL)
    found = plan_waypoints(task, np.random.default_rng(0)).poses
    path = PushPlanner(task).path(found, None)
    assert_free(task, path)
    assert_can_be_pushed(path)
    with pytest.raises(AssertionError):
        assert_can_be_pushed(found)  # which is why it is needed


def test_round_a_corner_with_as_few_pushes_as_there_is_room_for():
    # the shortest way touches both corners of the block; a little away from them, three pushes get round it
    scene = load_scene("puck_around", seed=0)
    query = ObjectPathQuery(scene, scene.start_state(), scene.goal, 0, 60.0, 10_000)
    poses = local_components().object_path.plan_path(query).poses
    pushes = push_planner(scene, scene.start_state(), "puck", poses)
    path = pushes.path(poses, None)
    way = np.diff(path[:, :2], axis=0)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))) > np.deg2rad(5.0)
    assert turned.sum() == 2
    assert all(pushes.checker.motion_free(a, b) for a, b in zip(path, path[1:], strict=False))


def test_other_sides_are_preferred_at_random_and_the_same_seed_gives_the_same():
    task = problem(at(0, 0), at(0.2, 0.15))
    planner, way = PushPlanner(task), straight(task)
    first = [planner.path(way, np.random.default_rng(seed)) for seed in range(8)]
    again = [PushPlanner(task).path(way, np.random.default_rng(seed)) for seed in range(8)]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert len({path.tobytes() for path in first}) > 1
    for path in first:
        assert_free(task, path)
        assert_can_be_pushed(path)


def test_what_has_no_flat_sides_or_no_room_or_no_table_has_no_way():
    disc = replace(CRATE, shapes=(Shape(ShapeKind.CYLINDER, (0.05, 0.08)),))
    task = problem(at(0, 0), at(0.2, 0.0), body=disc)
    assert PushPlanner(task).path(straight(task), None) is None
    walls = [box(f"w{s}", (0.6, 0.02, 0.1), (0.1, s * 0.076, 0.1)) for s in (-1, 1)]
    turned = problem(at(0, 0), at(0.2, 0.0, 90), *walls)
    assert PushPlanner(turned).path(straight(turned), None) is None
    flying = ObjectPathProblem(CRATE, pose((0, 0, 0.3)), pose((0.2, 0, 0.3)), (TABLE,))
    assert PushPlanner(flying).path(straight(flying), None) is None


def test_ways_in_end_at_the_goal_and_come_from_all_sides():
    ways = final_pushes(CRATE, at(0.1, 0.2, 30), 4)
    assert len(ways) == 4
    for way in ways:
        np.testing.assert_allclose(way[-1], at(0.1, 0.2, 30))
        assert np.linalg.norm(way[0, :2] - way[-1, :2]) == pytest.approx(0.03)
        assert_can_be_pushed(way)
    assert len({np.round(way[0, :2], 6).tobytes() for way in ways}) == 4


def test_ways_out_begin_at_the_start_and_lead_to_all_sides():
    ways = first_pushes(CRATE, at(0.1, 0.2, 30), 4)
    assert len(ways) == 4
    for way in ways:
        np.testing.assert_allclose(way[0], at(0.1, 0.2, 30))
        assert np.linalg.norm(way[0, :2] - way[-1, :2]) == pytest.approx(0.03)
        assert_can_be_pushed(way)


def test_a_direction_is_avoided_by_turns_on_the_way():
    """As where no hand fits between the robot and the object: it is turned, and pushed on two other sides."""
    task = problem(at(0.0, 0.0), at(0.06, -0.2))
    planner = PushPlanner(task)
    plain, around = (planner.path(straight(task), None, avoided) for avoided in ((), (0.0,)))
    assert (np.abs(directions(plain)) < 10.0).any()
    assert not (np.abs(directions(around)) < 10.0).any()
    assert_can_be_pushed(around)
    assert_free(task, around)


def test_there_is_no_path_if_all_directions_are_avoided():
    task = problem(at(0.0, 0.0), at(0.06, -0.2))
    assert PushPlanner(task).path(straight(task), None, list(np.deg2rad(np.arange(0, 360, 45)))) is None
