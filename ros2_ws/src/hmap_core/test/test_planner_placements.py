"""Where obstacles are put: stable, free, clear of what will pass; the given place first, then the near ones."""

import numpy as np
import pytest
from obstacle_fixtures import gap, heavy_slab, tower

from hmap_core.collision.convex import set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.planner.obstruction import carried_by, met
from hmap_core.planner.placements import MIN_SPACE, PER_GROUP, STEADY, given_place, inside, level_faces, placements_of
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.sweep import joined, nearest, object_sweep, placed, robot_sweeps
from hmap_core.scenes import SceneBuilder
from hmap_core.transforms import interpolate, pose
from hmap_core.waypoints import stable_poses

APART_FROM_NOTHING = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # lifts a body by 1 m


def places_of(scene, name, way=(), unsteady=frozenset(), seed=0) -> list[np.ndarray]:
    return list(placements_of(scene, scene.start_state(), name, way, unsteady, np.random.default_rng(seed)))


def brick_way(scene):
    line = interpolate(scene.bodies["brick"].pose, scene.goal.pose, np.linspace(0, 1, 41))
    return object_sweep(scene, "brick", line)


def test_places_are_stable_free_and_clear_of_the_way(tmp_path):
    scene = gap(tmp_path)
    way, state = brick_way(scene), scene.start_state()
    around = placed_bodies(scene, state, "two")
    places = places_of(scene, "two", [way])
    assert len(places) >= 8
    for T in places:
        poses = np.array([T + APART_FROM_NOTHING, T])
        assert stable_poses(scene.bodies["two"], poses, around)[1]
        own = body_set(scene.bodies["two"])
        for other in around:
            assert set_distance(own, T, body_set(other), state.poses[other.name]) >= -1e-9
        apart = min(set_distance(way.shapes, place, own, T) for place in way.places)
        assert apart >= MIN_SPACE - 1e-9


def test_places_on_the_same_support_come_first_and_near_ones_before_far_ones(tmp_path):
    scene = gap(tmp_path)
    places = places_of(scene, "two")
    heights = [round(T[2], 3) for T in places]
    assert heights[:4] == [0.04] * 4 and heights == sorted(heights)
    assert 0.1 in heights  # on the walls, 6 cm high
    start = scene.bodies["two"].pose
    far = np.linalg.norm(places[0][:2] - start[:2])
    assert far < 0.3
    np.testing.assert_array_equal(places[0][3:], start[3:])


def test_places_near_an_edge_come_last(tmp_path):
    scene = gap(tmp_path)
    walls = level_faces(scene, scene.start_state(), frozenset({"one", "two", "brick", "table"}))
    for seed in range(8):
        for T in places_of(scene, "two", unsteady=frozenset({"table"}), seed=seed)[:PER_GROUP]:
            assert max(inside(face.polygon, T[None, :2])[0] for face in walls) >= STEADY


def test_steady_places_elsewhere_come_before_unsteady_ones_on_the_same_support():
    builder = SceneBuilder("rail", mode="physical")
    builder.add_box("table", [1.0, 1.0, 0.1], pose=[0.4, 0, -0.05])
    builder.add_box("rail", [0.4, 0.016, 0.04], pose=[0.4, 0.1, 0.02])
    builder.add_box("cube", [0.04, 0.04, 0.04], pose=[0.4, 0.1, 0.06], movable=True, mass=0.1)
    builder.add_box("brick", [0.04, 0.04, 0.04], pose=[0.4, -0.2, 0.02], movable=True, mass=0.1)
    builder.add_robot("arm", "panda", base_pose=[0, 0, 0])
    builder.set_goal("brick", pose=[0.5, -0.2, 0.02])
    heights = [round(float(T[2]), 3) for T in places_of(builder.build(), "cube")]
    assert heights[0] == 0.02 and heights[-1] == 0.06
    assert heights == sorted(heights)


def test_a_given_place_counts_unless_it_is_in_the_way(tmp_path):
    scene = gap(tmp_path, {"one": (0.3, 0.4, 0.04), "two": (0.5, 0.4, 0.04)})
    way = [brick_way(scene)]
    np.testing.assert_allclose(given_place(scene, "one", way)[0][:3], (0.3, 0.4, 0.04))
    assert given_place(scene, "two", way) == []
    assert len(given_place(scene, "two", [])) == 1
    assert given_place(gap(tmp_path), "one", way) == []


def test_the_same_seed_gives_the_same_places(tmp_path):
    scene = gap(tmp_path)
    a, b, other = (np.array(places_of(scene, "one", seed=seed)[:4]) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, other)


def test_nothing_is_put_on_what_will_move(tmp_path):
    scene = tower(tmp_path)
    tops = [T[2] for T in places_of(scene, "upper", unsteady=frozenset({"brick"}))]
    assert any(z == pytest.approx(0.085) for z in tops)  # on the lower box again
    tops = [T[2] for T in places_of(scene, "upper", unsteady=frozenset({"brick", "lower"}))]
    assert tops and all(z == pytest.approx(0.025) for z in tops)


def test_where_something_passes_everywhere_there_is_no_place(tmp_path):
    scene = gap(tmp_path)
    grid = [
        pose((x, y, z)) for x in np.arange(-1.2, 1.25, 0.1) for y in np.arange(-1.2, 1.25, 0.1) for z in (0.04, 0.1)
    ]
    assert places_of(scene, "one", [object_sweep(scene, "brick", np.array(grid))]) == []


def test_level_faces_are_the_tops_of_bodies(tmp_path):
    scene = heavy_slab(tmp_path)
    faces = level_faces(scene, scene.start_state(), frozenset({"slab"}))
    assert {f.owner for f in faces} == set(scene.bodies) - {"slab"}
    table = next(f for f in faces if f.owner == "table")
    assert table.height == pytest.approx(0.0)
    np.testing.assert_allclose(np.ptp(table.polygon, axis=0), (2.4, 2.4))


def test_what_stands_on_a_body_is_found(tmp_path):
    scene = tower(tmp_path)
    state = scene.start_state()
    assert carried_by(scene, state, "lower") == ("upper",)
    assert carried_by(scene, state, "upper") == ()
    assert set(carried_by(scene, state, "table")) == {"brick", "lower"}


def test_obstacles_are_told_in_the_order_in_which_the_path_meets_them(tmp_path):
    scene = gap(tmp_path)
    state = scene.start_state()
    state.poses["one"] = pose((0.5, 0.40, 0.04))
    state.poses["two"] = pose((0.5, 0.25, 0.04))
    line = interpolate(state.poses["brick"], scene.goal.pose, np.linspace(0, 1, 41))
    assert met(scene, state, "brick", line, ("one", "two")) == ("two", "one")


def test_sweeps_measure_the_distance_of_a_robot(tmp_path):
    scene = gap(tmp_path)
    robot, state = scene.robots["arm"], scene.start_state()
    bodies = placed(scene, state, ["one", "two"])
    q = np.linspace(state.q["arm"], state.q["arm"] + [0.5, 0, 0, 0, 0, 0, 0], 20)
    high = nearest(robot_sweeps(robot, q, np.zeros(20)), bodies, 0.05)
    assert high == {}
    low = q + [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert min(nearest(robot_sweeps(robot, low, np.zeros(20)), bodies, 0.5).values()) < 0.2
    together = joined(list(bodies.values()))
    assert len(together) == 2 and len(together.vertices) == 16
