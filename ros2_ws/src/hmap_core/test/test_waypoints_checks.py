"""The exact motion check against dense sampling, the sampling planner alone, and the support check."""

import numpy as np
import pytest
from geometry_fixtures import TABLE, body_distances, box, dense, worst_distance
from waypoints_fixtures import SLACK, U_WALLS, WINDOW, u_problem, window_problem

from hmap_core.collision.convex import convex_set
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, interpolate, pose
from hmap_core.types import BodyKind, Shape, ShapeKind
from hmap_core.waypoints import DEFAULT_MIN_DISTANCE, ObjectPathProblem
from hmap_core.waypoints.checker import Geometry, ObjectChecker, ObstacleShapes
from hmap_core.waypoints.kernels import between, length
from hmap_core.waypoints.rrt import rrt_path
from hmap_core.waypoints.search import search_bounds
from hmap_core.waypoints.search_budget import SearchBudget
from hmap_core.waypoints.shorten import relax, smooth
from hmap_core.waypoints.support import Support


def random_pose(rng, spread):
    return pose(rng.uniform(-spread, spread, 3), rng.standard_normal(4))


def checker_of(problem, planar):
    return ObjectChecker(problem, Geometry(problem), planar, problem.min_distance)


def test_the_motion_check_agrees_with_dense_sampling():
    rng = np.random.default_rng(0)
    body = box("body", (0.3, 0.1, 0.05), (0, 0, 0))
    free = blocked = 0
    for _ in range(30):
        obstacles = tuple(box(f"o{k}", rng.uniform(0.02, 0.3, 3), (0, 0, 0)) for k in range(4))
        obstacles = tuple(type(o)(o.name, o.kind, o.shapes, random_pose(rng, 0.4)) for o in obstacles)
        a, b = random_pose(rng, 0.5), random_pose(rng, 0.5)
        far = pose((9, 9, 9))  # nothing is touched at the ends, so the minimum distance holds everywhere
        checker = checker_of(ObjectPathProblem(body, far, far, obstacles, motion="spatial"), False)
        worst = min(min(body_distances(body, T, obstacles).values()) for T in dense([a, b], 4e-3, 0.17))
        if checker.motion_free(a, b):
            free += 1
            assert worst > DEFAULT_MIN_DISTANCE - SLACK
        else:
            blocked += 1
            assert worst < DEFAULT_MIN_DISTANCE + 4e-3
        part = checker.free_part(a, b)
        if part > 0.0:
            assert (
                worst_distance(body, [a, interpolate(a, b, part)], obstacles, 1e-2, 0.17) > DEFAULT_MIN_DISTANCE - SLACK
            )
    assert free > 5 and blocked > 5


def test_sliding_along_a_touching_wall_is_free_and_leaning_into_it_is_not():
    wall = box("wall", (2.0, 0.1, 0.2), (0, 0.1, 0.15))
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    start, goal = pose((-0.5, 0, 0.1)), pose((0.5, 0, 0.1))
    checker = checker_of(ObjectPathProblem(cube, start, goal, (TABLE, wall)), True)
    assert checker.motion_free(start, goal)
    assert not checker.motion_free(start, pose((0.5, 0.002, 0.1)))


def test_lengths_and_interpolation_agree_with_the_transforms():
    rng = np.random.default_rng(1)
    for _ in range(50):
        a, b = random_pose(rng, 1.0), random_pose(rng, 1.0)
        t = rng.random(5)
        ours, theirs = between(a, b, t), interpolate(a, b, t)
        sign = np.sign(np.sum(ours[:, 3:] * theirs[:, 3:], axis=1, keepdims=True))
        np.testing.assert_allclose(ours[:, :3], theirs[:, :3], atol=1e-12)
        np.testing.assert_allclose(ours[:, 3:] * sign, theirs[:, 3:], atol=1e-9)
    turned = pose((0, 0, 0), (0, 0, np.sin(5e-7), np.cos(5e-7)))
    np.testing.assert_allclose(length(IDENTITY, turned, 2.0), 2e-6, rtol=1e-6)


@pytest.mark.parametrize(
    ("problem", "planar", "walls"), [(u_problem(), True, U_WALLS), (window_problem(), False, WINDOW)]
)
def test_the_trees_alone_are_repeatable_and_right(problem, planar, walls):
    """Several solves in one process: the same seed gives the same path whatever came in between."""

    def solve(seed):
        checker = checker_of(problem, planar)
        bounds = search_bounds(problem, checker)
        rng = np.random.default_rng(seed)
        path = rrt_path(checker, [problem.start], [problem.goal], bounds, rng, SearchBudget(30.0), scale=8)
        return path, smooth(checker, path, rng)

    first, other, again = solve(3), solve(4), solve(3)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert other[0].shape != first[0].shape or not np.allclose(other[0], first[0])
    for path in (first[0], other[1]):
        assert worst_distance(problem.body, path, walls, step=4e-3, radius=0.15) > DEFAULT_MIN_DISTANCE - SLACK


def book_on_boards() -> ObjectChecker:
    """A book goes from one board to the one above it."""
    boards = [box(f"board{k}", (0.4, 0.3, 0.02), (0, 0, 0.3 * k)) for k in range(2)]
    book = box("book", (0.06, 0.2, 0.2), (0, 0, 0), kind=BodyKind.MOVABLE)
    start, goal = pose((0, 0, 0.11)), pose((0, 0, 0.41))
    problem = ObjectPathProblem(book, start, goal, tuple(boards), motion="spatial", min_distance=0.01)
    return checker_of(problem, False)


@pytest.mark.parametrize("seed", range(4))
def test_shortcuts_do_not_brush_what_is_touched_at_the_goal(seed):
    """Round the front of a board there is room; the book comes to it from above."""
    checker = book_on_boards()
    upper = checker.owners.index("board1")
    way = [(0, 0, 0.11), (0, 0.4, 0.11), (0.1, 0.4, 0.25), (0, 0.4, 0.46), (0, 0.25, 0.44), (0, 0, 0.41)]
    path = smooth(checker, np.array([pose(at) for at in way]), np.random.default_rng(seed))
    assert 3 < len(path) <= len(way)
    poses = np.concatenate([interpolate(a, b, np.linspace(0, 1, 60)) for a, b in zip(path, path[1:], strict=False)])
    before = poses[: np.flatnonzero(poses[:, 2] < 0.4)[-1] + 1]  # it has not come over the board
    assert min(checker.distances(T)[upper] for T in before) >= 0.01 - SLACK


def test_what_is_touched_at_the_goal_is_not_brushed_on_the_way_there():
    """A book goes round the front of the board on which it will stand; from its old place it slides out, as it did."""
    checker = book_on_boards()
    start, goal = pose((0, 0, 0.11)), pose((0, 0, 0.41))
    out, over = pose((0, 0.29, 0.11)), pose((0, 0.3, 0.41))
    brushing = pose((0, 0.2511, 0.25))  # 1 mm in front of the upper board
    path = relax(checker, np.array([start, out, brushing, over, goal]))
    np.testing.assert_array_equal(path[[0, 4]], [start, goal])
    upper = checker.owners.index("board1")
    passing = interpolate(path[1], path[2], np.linspace(0, 1, 40)), interpolate(path[2], path[3], np.linspace(0, 1, 40))
    assert checker.distances(brushing)[upper] < 0.002
    assert min(checker.distances(T)[upper] for T in np.concatenate(passing)) >= 0.01


def test_the_mass_centre_weighs_shapes_by_volume():
    shapes = (Shape(ShapeKind.BOX, (0.2, 0.1, 0.1)), Shape(ShapeKind.BOX, (0.1, 0.1, 0.1), pose((0.3, 0, 0))))
    np.testing.assert_allclose(centre_of_mass(convex_set(shapes)), [0.1, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("x", "held"), [(0.4, True), (0.494, True), (0.497, False), (0.6, False)])
def test_a_cube_at_the_edge_of_its_table(x, held):
    """It tips when its centre comes within SUPPORT_MARGIN (5 mm) of the edge at x = 0.5."""
    table = box("table", (1.0, 1.0, 0.1), (0, 0, 0))
    cube = convex_set(box("cube", (0.1, 0.1, 0.1), (0, 0, 0)).shapes)
    support = Support(cube, ObstacleShapes.of((table,)).hulls, pose((0, 0, 0.1)))
    assert support.is_stable(pose((x, 0, 0.1))) == held
    turned = pose((x, 0, 0.1), (0, 0, np.sin(0.4), np.cos(0.4)))
    assert support.is_stable(turned) == held


def test_a_plank_bridges_two_blocks_that_do_not_lie_under_its_centre():
    blocks = tuple(box(f"block{s}", (0.1, 0.2, 0.1), (0.3 * s, 0, 0)) for s in (-1, 1))
    plank = convex_set(box("plank", (0.8, 0.1, 0.02), (0, 0, 0)).shapes)
    support = Support(plank, ObstacleShapes.of(blocks).hulls, pose((0, 0, 0.06)))
    assert support.is_stable(pose((0, 0, 0.06)))
    assert not support.is_stable(pose((0.4, 0, 0.06)))
