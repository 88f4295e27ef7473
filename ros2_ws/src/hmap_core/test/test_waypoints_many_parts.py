"""Object paths of bodies of many parts, among obstacles of many parts; and how far a search for a path goes."""

import time
from dataclasses import replace

import numpy as np
import pytest
from geometry_fixtures import box
from many_parts_fixtures import ends_within, parts, random_pose

from hmap_core import clock
from hmap_core.benchmark.many_parts import window
from hmap_core.collision.bvh import build_tree
from hmap_core.collision.convex import convex_set
from hmap_core.stability import mass
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import NoObjectPath, ObjectPathProblem, checker, plan_waypoints
from hmap_core.waypoints.checker import Geometry, ObjectChecker
from hmap_core.waypoints.enclosure import enclosure, inner_ball

LATE = 0.05  # s that a look at the clock comes late

FAR = pose((9, 9, 9))
RESOLVED = 1e-3  # of the parameter; motions are at most 2 m, and checked to 0.4 mm


def both(monkeypatch, problem, planar=False, min_distance=0.002):
    """Two checkers of one problem: one compares all pairs, the other one finds the near ones with trees."""
    found = []
    for limit in (np.inf, 0):
        monkeypatch.setattr(checker, "MANY_PAIRS", limit)
        found.append(ObjectChecker(problem, Geometry(problem), planar, min_distance))
    return found


@pytest.mark.parametrize("n", [1, 2, 3, 100])
def test_a_tree_holds_every_box_once_inside_its_ancestors(n):
    rng = np.random.default_rng(n)
    lower = rng.uniform(-1, 1, (n, 3))
    upper = lower + rng.uniform(0, 0.2, (n, 3))
    tree = build_tree(lower, upper)
    assert sorted(tree.item[tree.item >= 0]) == list(range(n)) and len(tree.item) == 2 * n - 1

    def check(node):
        low, high = tree.center[node] - tree.half[node], tree.center[node] + tree.half[node]
        if tree.item[node] >= 0:
            items = [tree.item[node]]
        else:
            items = check(node + 1) + check(tree.second[node])
        assert np.all(lower[items] >= low - 1e-12) and np.all(upper[items] <= high + 1e-12)
        return items

    assert len(check(0)) == n
    assert len(build_tree(lower[:0], upper[:0]).item) == 0


def test_the_trees_find_what_the_comparison_of_all_pairs_finds(monkeypatch):
    rng = np.random.default_rng(0)
    free = blocked = 0
    for _ in range(12):
        body, scene = parts("body", 9, rng, 0.2), parts("scene", 14, rng, 0.5)
        every, trees = both(monkeypatch, ObjectPathProblem(body, FAR, FAR, (scene,), "spatial"))
        poses = [random_pose(rng, 0.7) for _ in range(12)]
        for T in poses:
            assert trees.pose_free(T) == every.pose_free(T)
            capped = np.minimum(every.distances(T), trees._range)
            np.testing.assert_allclose(trees.distances(T), capped, atol=1e-7)
        np.testing.assert_allclose(trees.clearances(np.array(poses)), every.clearances(np.array(poses)), atol=1e-7)
        for a, b in zip(poses[:-1], poses[1:], strict=True):
            assert trees.motion_free(a, b) == every.motion_free(a, b)
            assert trees.free_part(a, b) == pytest.approx(every.free_part(a, b), abs=RESOLVED)
            assert trees.motion_free(a, b, 0.01) == every.motion_free(a, b, 0.01)
            assert trees.hit_by(a, b) == every.hit_by(a, b)
            free, blocked = free + trees.motion_free(a, b), blocked + (not trees.motion_free(a, b))
    assert free > 10 and blocked > 10


def test_a_concave_body_of_many_parts_passes_a_window_of_many_parts():
    problem = window(300, 300, 0)
    path = plan_waypoints(problem, np.random.default_rng(0), 60.0)
    every = ObjectChecker(problem, Geometry(problem), False, 0.002)
    assert all(every.motion_free(a, b) for a, b in zip(path.poses[:-1], path.poses[1:], strict=True))
    assert path.clearance.min() > 0.4e-3
    again = plan_waypoints(problem, np.random.default_rng(0), 60.0)
    np.testing.assert_array_equal(again.poses, path.poses)


@pytest.mark.parametrize("limit", [0.5, 1.5])
def test_a_search_among_many_parts_keeps_its_time_limit(limit):
    problem = window(1000, 1000, 1, lid=True)

    def search():
        with pytest.raises(NoObjectPath, match=f"the search ended with its time limit of {limit} s") as error:
            plan_waypoints(problem, np.random.default_rng(0), limit)
        assert not error.value.proven and "lid" in error.value.blockers

    assert ends_within(1.1 * limit + LATE, search)


def tiles_and_comb(n, closed):
    """A comb of about n boxes stands on n/2 tiles, before a wall of n/2 posts."""
    side, posts = int(np.sqrt(n / 2)), n // 2
    cells = (np.arange(side) + 0.5) * 2.0 / side - 1.0
    cell = (2.001 / side, 2.001 / side, 0.05)
    tiles = tuple(Shape(ShapeKind.BOX, cell, pose((x, y, -0.025))) for x in cells for y in cells)
    rows = [y for y in np.linspace(-1, 1, posts) if closed or abs(y) >= 0.25]
    wall = tuple(Shape(ShapeKind.BOX, (0.03, 2.4 / posts, 0.2), pose((0, y, 0.1))) for y in rows)
    width = round(n ** (1 / 3))
    teeth = (np.arange(width) + 0.5) * 0.2 / width - 0.1
    tooth = (0.2 / width, 0.2 / width, 0.05 / width)
    comb = tuple(Shape(ShapeKind.BOX, tooth, pose((x, y, z / 4))) for x in teeth for y in teeth for z in teeth)
    body = Body("comb", BodyKind.MOVABLE, comb, pose((-0.5, 0.3, 0.025)), 1.0)
    floor, fence = Body("floor", BodyKind.FIXED, tiles, pose()), Body("wall", BodyKind.MOVABLE, wall, pose(), 1.0)
    return ObjectPathProblem(body, pose((-0.5, 0.3, 0.025)), pose((0.5, -0.3, 0.025)), (floor, fence))


@pytest.mark.parametrize("removable", [False, True])
@pytest.mark.parametrize("limit", [0.3, 1.0])
def test_a_search_of_pushes_among_many_parts_keeps_its_time_limit(limit, removable):
    """Its proofs, its checks of support, and what is looked at after the limit take no time beyond it."""
    problem = replace(tiles_and_comb(1000, closed=True), removable=frozenset({"wall"} if removable else ()))

    def search():
        with pytest.raises(NoObjectPath):
            plan_waypoints(problem, np.random.default_rng(0), limit)

    assert ends_within(1.1 * limit + LATE, search)


def test_a_path_among_many_parts_is_found_and_smoothed_well_within_its_time():
    problem, paths = tiles_and_comb(1000, closed=False), []
    assert ends_within(2.0, lambda: paths.append(plan_waypoints(problem, np.random.default_rng(0), 10.0)))
    assert len(paths[-1].poses) > 2


def test_a_search_that_has_no_time_says_so():
    with pytest.raises(NoObjectPath, match="none was looked at; the search ended with its time limit of 1e-06 s"):
        plan_waypoints(tiles_and_comb(60, closed=True), np.random.default_rng(0), 1e-6)


def test_a_flood_ends_at_its_deadline():
    problem = window(30, 200, 3, lid=True)
    geometry = Geometry(problem)
    began = time.thread_time()
    ends = problem.start, problem.goal
    assert enclosure("bracket", geometry.body, geometry.obstacles, *ends, deadline=clock.now() - 1.0) is None
    assert time.thread_time() - began < 0.5


def test_mass_and_largest_ball_of_many_boxes_are_those_of_each_hull(monkeypatch):
    shapes = [*parts("body", 40, np.random.default_rng(1), 0.3).shapes, Shape(ShapeKind.CYLINDER, (0.05, 0.1), pose())]
    own = convex_set(shapes)
    centre = mass.centre_of_mass(own)
    mass.centre_of_mass.cache_clear()
    monkeypatch.setattr(mass, "MANY_SHAPES", np.inf)
    assert centre == pytest.approx(mass.centre_of_mass(own), abs=1e-12)
    each = [inner_ball(convex_set((shape,)))[1] for shape in shapes]
    assert inner_ball(own)[1] == pytest.approx(max(each), abs=1e-9)
    boxes = [(min(shape.size) / 2, radius) for shape, radius in zip(shapes, each, strict=True) if shape.kind == "box"]
    assert all(radius == pytest.approx(expected, abs=1e-9) for expected, radius in boxes)


def test_many_feet_on_many_tiles_stand_as_one_foot_on_one_tile(monkeypatch):
    rng = np.random.default_rng(0)
    size, n = 0.3, 12
    cells = (np.arange(n) + 0.5) / n - 0.5

    def tiled(name, extent, height, kind, at):
        shapes = tuple(
            Shape(ShapeKind.BOX, (extent / n, extent / n, height), pose((extent * x, extent * y, 0)))
            for x in cells
            for y in cells
        )
        return Body(name, kind, shapes, pose(at), 1.0)

    start = pose((0, 0, 0.05))
    tiles, board = tiled("tiles", 1.0, 0.05, BodyKind.FIXED, (0, 0, 0)), box("board", (1, 1, 0.05), (0, 0, 0))
    feet, foot = tiled("feet", size, 0.05, BodyKind.MOVABLE, (0, 0, 0)), box("foot", (size, size, 0.05), (0, 0, 0))
    many, one = (
        ObjectChecker(
            problem := ObjectPathProblem(body, start, start, (floor,)), Geometry(problem), True, 0.002
        ).support
        for body, floor in ((feet, tiles), (foot, board))
    )
    stable = 0
    for _ in range(200):
        x, y, angle = *rng.uniform(-0.7, 0.7, 2), rng.uniform(-3, 3)
        T = pose((x, y, 0.05), (0, 0, np.sin(angle / 2), np.cos(angle / 2)))
        assert many.is_stable(T) == one.is_stable(T)
        stable += one.is_stable(T)
    assert 40 < stable < 160


def maze(gap_at):
    """A wall of 8 m, closed behind start and goal, with a gap."""
    left, right = gap_at - 0.25 + 4.0, 4.0 - gap_at - 0.25
    return (
        box("floor", (12, 12, 0.1), (0, 0, -0.05)),
        box("left", (0.05, left, 0.3), (0, -4.0 + left / 2, 0.15)),
        box("right", (0.05, right, 0.3), (0, 4.0 - right / 2, 0.15)),
        *(box(f"end{s}", (3.0, 0.05, 0.3), (0, s * 4.0, 0.15)) for s in (-1, 1)),
        *(box(f"side{s}", (0.05, 8.0, 0.3), (s * 1.5, 0, 0.15)) for s in (-1, 1)),
    )


@pytest.mark.parametrize("motion", ["planar", "spatial"])
def test_a_gap_that_is_far_away_is_found(motion):
    """It lies outside the first bounds of the search, 1 m round start and goal; in space a ceiling closes the top."""
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0), kind=BodyKind.MOVABLE)
    walls = maze(3.2)
    if motion == "spatial":
        walls = (*walls, box("ceiling", (12, 12, 0.1), (0, 0, 0.35)))
    problem = ObjectPathProblem(cube, pose((-0.5, 0, 0.05)), pose((0.5, 0, 0.05)), walls, motion)
    path = plan_waypoints(problem, np.random.default_rng(0), 60.0)
    assert path.poses[:, 1].max() > 2.9


def test_no_path_is_said_to_be_proven_only_if_it_is():
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0), kind=BodyKind.MOVABLE)
    ends = pose((-0.5, 0, 0.05)), pose((0.5, 0, 0.05))
    rng = np.random.default_rng(0)
    closed = (*maze(3.2), box("gate", (0.05, 0.6, 0.3), (0, 3.2, 0.15)))
    with pytest.raises(NoObjectPath, match="it is proven that there is none$") as error:
        plan_waypoints(ObjectPathProblem(cube, *ends, closed, "planar"), rng, 60.0)
    assert error.value.proven
    bounds = np.array([[-1.5, -1.5, 0], [1.5, 1.5, 0.1]])
    with pytest.raises(NoObjectPath, match="it is proven that there is none within its bounds") as error:
        plan_waypoints(ObjectPathProblem(cube, *ends, maze(3.2), "planar", bounds=bounds), rng, 60.0)
    assert error.value.proven
    ceiling = box("ceiling", (12, 12, 0.1), (0, 0, 0.35))
    with pytest.raises(NoObjectPath, match="the search ended with all its 3000 motions") as error:
        plan_waypoints(ObjectPathProblem(cube, *ends, (*closed, ceiling), "spatial"), rng, 60.0, 3000)
    assert not error.value.proven
