"""Paths of the object alone, verified between the poses by another library."""

import time

import numpy as np
import pytest
from geometry_fixtures import TABLE, box, worst_distance, yaw
from waypoints_fixtures import BAR, SLACK, TUNNELS, U_WALLS, WINDOW, two_doors_problem, u_problem, window_problem

from hmap_core.exceptions import Code, InputError, WaypointError
from hmap_core.transforms import distance, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import DEFAULT_MIN_DISTANCE, NoObjectPath, ObjectPathProblem, plan_waypoints
from hmap_core.waypoints.resample import POSITION_STEP, ROTATION_STEP


def plan(problem, seed=0, limit=20.0):
    return plan_waypoints(problem, np.random.default_rng(seed), limit)


def check_ends_of(path, problem):
    np.testing.assert_allclose(path.poses[0], problem.start, atol=1e-12)
    assert max(distance(path.poses[-1], problem.goal)) < 1e-12


def check_shape_of(path, problem):
    """What holds for every path: ends, spacing, signs, waypoints."""
    check_ends_of(path, problem)
    assert path.cuts[-1] == len(path.poses) - 1
    assert np.all(np.diff(path.cuts) > 0) and path.cuts[0] > 0
    assert path.clearance.shape == (len(path.poses),)
    for a, b in zip(path.poses[:-1], path.poses[1:], strict=True):
        d, angle = distance(a, b)
        assert d <= POSITION_STEP + 1e-9 and angle <= ROTATION_STEP + 1e-9
        assert a[3:] @ b[3:] > 0.0


def test_a_bar_slides_straight_through_a_tunnel_with_5_mm_a_side():
    problem = ObjectPathProblem(BAR, pose((-0.64, 0.25, 0.09)), pose((0.5, 0.25, 0.09)), (TABLE, *TUNNELS))
    path = plan(problem)
    check_shape_of(path, problem)
    assert path.motion == "planar"
    assert len(path.cuts) == 1  # a straight run has no waypoint of its own
    np.testing.assert_allclose(path.clearance.min(), 0.005, atol=1e-9)
    assert worst_distance(BAR, path.poses, TUNNELS) > 0.0049


def test_a_turned_bar_is_put_into_the_tunnel():
    problem = ObjectPathProblem(BAR, pose((0.6, -0.3, 0.09), yaw(1.0)), pose((-0.64, 0.25, 0.09)), (TABLE, *TUNNELS))
    path = plan(problem)
    check_shape_of(path, problem)
    assert worst_distance(BAR, path.poses, TUNNELS) > DEFAULT_MIN_DISTANCE - SLACK


@pytest.mark.parametrize("seed", range(3))
def test_round_a_u(seed):
    problem = u_problem()
    path = plan(problem, seed)
    check_shape_of(path, problem)
    assert path.motion == "planar"
    np.testing.assert_allclose(path.poses[:, 2], 0.1, atol=1e-12)
    assert worst_distance(problem.body, path.poses, U_WALLS, radius=0.14) > DEFAULT_MIN_DISTANCE - SLACK
    assert len(path.cuts) <= 5


@pytest.mark.parametrize("seed", range(3))
def test_through_a_window_too_low_to_pass_straight(seed):
    problem = window_problem()
    path = plan(problem, seed)
    check_shape_of(path, problem)
    assert path.motion == "spatial"
    assert worst_distance(problem.body, path.poses, (TABLE, *WINDOW), radius=0.14) > DEFAULT_MIN_DISTANCE - SLACK


@pytest.mark.parametrize("problem", [u_problem(), window_problem()])
def test_the_same_seed_gives_the_same_path(problem):
    first, second = plan(problem, 7), plan(problem, 7)
    np.testing.assert_array_equal(first.poses, second.poses)
    np.testing.assert_array_equal(first.cuts, second.cuts)


def test_what_blocks_is_named_and_what_to_remove():
    cube = box("cube", (0.05, 0.05, 0.05), (-0.05, 0.25, 0.075), kind=BodyKind.MOVABLE)
    bystander = box("bystander", (0.05, 0.05, 0.05), (-0.05, 0.8, 0.075), kind=BodyKind.MOVABLE)
    problem = ObjectPathProblem(
        BAR,
        pose((-0.64, 0.25, 0.09)),
        pose((0.5, 0.25, 0.09)),
        (TABLE, *TUNNELS, cube, bystander),
        motion="planar",
        removable=frozenset({"cube", "bystander"}),
    )
    with pytest.raises(WaypointError) as error:
        plan(problem, limit=1.0)
    assert error.value.code == Code.NO_OBJECT_PATH
    assert error.value.blockers[0] == "cube"
    assert "bystander" not in error.value.free_without
    assert error.value.free_without == ("cube",)
    assert "'cube'" in error.value.reason


@pytest.mark.parametrize("seed", range(3))
def test_the_fewest_bodies_are_named(seed):
    """Of eight boxes three stand in one door, two in the other and three in the open: those two have to go."""
    problem = two_doors_problem()
    with pytest.raises(NoObjectPath) as error:
        plan(problem, seed)
    assert sorted(error.value.free_without) == ["b0", "b1"]
    path = error.value.path_without
    check_shape_of(path, problem)
    gone = {"b0", "b1", TABLE.name}
    standing = [body for body in problem.obstacles if body.name not in gone]
    assert worst_distance(problem.body, path.poses, standing, radius=0.08) > 0.25 * DEFAULT_MIN_DISTANCE - SLACK
    with pytest.raises(NoObjectPath) as again:
        plan(problem, seed)
    assert again.value.free_without == error.value.free_without
    np.testing.assert_array_equal(again.value.path_without.poses, path.poses)


def test_a_body_at_the_goal_has_to_go():
    """That is known at once: nothing is searched but the way that is then free."""
    taken = [box(f"cube{k}", (0.04, 0.04, 0.04), (0.5 + 0.04 * k, 0, 0.07), kind=BodyKind.MOVABLE) for k in range(3)]
    brick = box("brick", (0.06, 0.06, 0.06), (0, 0, 0))
    names = frozenset(body.name for body in taken)
    problem = ObjectPathProblem(brick, pose((0, 0, 0.08)), pose((0.5, 0, 0.08)), (TABLE, *taken), removable=names)
    with pytest.raises(NoObjectPath) as error:
        plan(problem)
    assert error.value.free_without == ("cube0", "cube1")  # the third is 10 mm beyond the goal's edge
    check_ends_of(error.value.path_without, problem)
    fixed = ObjectPathProblem(brick, problem.start, problem.goal, problem.obstacles, removable=names - {"cube1"})
    with pytest.raises(InputError, match="penetrates 'cube1' by 10.0 mm at its goal") as error:
        plan(fixed)
    assert error.value.code == Code.GOAL_IN_COLLISION


def test_a_closed_tray_is_proven_to_be_closed():
    """No time is spent on sliding: what is proven to be closed is given up at once, or lifted out of."""
    sides = [box(f"side{k}", (0.5, 0.02, 0.1), (0, s * 0.24, 0.1)) for k, s in enumerate((-1, 1))]
    ends = [box(f"end{k}", (0.02, 0.5, 0.1), (s * 0.24, 0, 0.1)) for k, s in enumerate((-1, 1))]
    cube = box("cube", (0.08, 0.08, 0.08), (0, 0, 0))
    start, goal = pose((0, 0, 0.09)), pose((0.6, 0.1, 0.09))
    began = time.monotonic()
    with pytest.raises(NoObjectPath):
        plan(ObjectPathProblem(cube, start, goal, (TABLE, *sides, *ends), motion="planar"), limit=60.0)
    assert time.monotonic() - began < 20.0
    assert plan(ObjectPathProblem(cube, start, goal, (TABLE, *sides, *ends))).motion == "spatial"
    gate = (TABLE, *sides, ends[0], box("end1", (0.02, 0.39, 0.1), (0.24, -0.055, 0.1)))  # leaves 85 mm beside side1
    assert plan(ObjectPathProblem(cube, start, goal, gate, motion="planar"), limit=60.0).motion == "planar"


def test_a_wall_that_cannot_be_removed_is_named():
    walls = [box("wall", (0.05, 4.0, 3.0), (0.0, 0.0, 1.5))]
    problem = ObjectPathProblem(BAR, pose((-0.8, 0, 0.09)), pose((0.8, 0, 0.09)), (TABLE, *walls))
    with pytest.raises(WaypointError) as error:
        plan(problem, limit=0.5)
    assert error.value.blockers == ("wall",)
    assert error.value.free_without is None


@pytest.mark.parametrize(
    ("start", "goal", "code"),
    [(-0.03, 0.5, Code.START_IN_COLLISION), (0.5, -0.03, Code.GOAL_IN_COLLISION)],
)
def test_an_end_in_collision_names_the_body_and_the_depth(start, goal, code):
    block = box("block", (0.1, 0.1, 0.1), (0.0, 0.0, 0.1))
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    problem = ObjectPathProblem(cube, pose((start - 0.05, 0, 0.1)), pose((goal - 0.05, 0, 0.1)), (TABLE, block))
    with pytest.raises(InputError) as error:
        plan(problem)
    assert error.value.code == code
    assert "'block' by 20.0 mm" in error.value.reason


def test_a_book_between_touching_books_is_pulled_out():
    book = box("book", (0.06, 0.2, 0.2), (0, 0, 0))
    # one neighbour touches, the other is pressed in by half a millimetre
    others = [box("left", (0.06, 0.2, 0.2), (-0.06, 0, 0.15)), box("right", (0.06, 0.2, 0.2), (0.0595, 0, 0.15))]
    problem = ObjectPathProblem(book, pose((0, 0, 0.15)), pose((0, 0.5, 0.15)), (TABLE, *others))
    path = plan(problem)
    assert path.motion == "planar"
    assert worst_distance(book, path.poses, others, radius=0.15) > -1e-3


def test_a_slide_stays_on_its_support():
    """A gap wider than the object can bridge is not crossed on the plane; a narrow one is."""
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    start, goal = pose((-0.4, 0, 0.1)), pose((0.4, 0, 0.1))

    def tables(gap):
        return tuple(box(f"table{s}", (0.8, 0.3, 0.1), (s * (0.4 + gap / 2), 0, 0)) for s in (-1, 1))

    assert plan(ObjectPathProblem(cube, start, goal, tables(0.04), motion="planar")).motion == "planar"
    wide = tables(0.3)
    with pytest.raises(WaypointError, match="leaves the support"):
        plan(ObjectPathProblem(cube, start, goal, wide, motion="planar"), limit=0.5)
    path = plan(ObjectPathProblem(cube, start, goal, wide, motion="auto"), limit=2.0)
    assert path.motion == "spatial"


def test_seams_between_tables_and_steps_up():
    tables = [box(f"table{k}", (0.5, 1.0, 0.1), (0.5 * k, 0, 0)) for k in range(3)]
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    path = plan(ObjectPathProblem(cube, pose((0, 0, 0.1)), pose((1, 0, 0.1)), tuple(tables)))
    assert path.motion == "planar" and len(path.cuts) == 1
    up = plan(ObjectPathProblem(cube, pose((0, 0, 0.1)), pose((1, 0, 0.25)), tuple(tables)))
    assert up.motion == "spatial"


def test_a_thin_wall_is_not_jumped():
    """Steps never hide a 1 mm sheet."""
    sheet = box("sheet", (0.001, 0.6, 0.4), (0, 0, 0.25))
    cube = box("cube", (0.05, 0.05, 0.05), (0, 0, 0))
    problem = ObjectPathProblem(cube, pose((-0.3, 0, 0.075)), pose((0.3, 0, 0.075)), (TABLE, sheet))
    path = plan(problem)
    assert worst_distance(cube, path.poses, [sheet], step=5e-4, radius=0.05) > DEFAULT_MIN_DISTANCE - SLACK


def test_a_bolt_of_two_shapes_keeps_both_clear():
    shapes = (Shape(ShapeKind.BOX, (0.04, 0.3, 0.04)), Shape(ShapeKind.BOX, (0.3, 0.04, 0.04), pose((0, 0.17, 0))))
    bolt = Body("bolt", BodyKind.MOVABLE, shapes, pose())
    posts = [box("post_a", (0.04, 0.04, 0.3), (0.2, 0.1, 0.2)), box("post_b", (0.04, 0.04, 0.3), (0.2, -0.3, 0.2))]
    problem = ObjectPathProblem(bolt, pose((-0.1, 0, 0.07)), pose((0.6, 0, 0.07)), (TABLE, *posts))
    path = plan(problem)
    assert worst_distance(bolt, path.poses, posts, radius=0.25) > DEFAULT_MIN_DISTANCE - SLACK


def test_a_bolt_is_turned_in_its_channel_over_a_rib():
    """The bar has 0.8 mm of room above and below while it turns: the minimum distance is given up in part, the
    contact is not."""
    shapes = (Shape(ShapeKind.BOX, (0.04, 0.21, 0.04)), Shape(ShapeKind.BOX, (1.0, 0.1, 0.1), pose((0, -0.15, 0))))
    bolt = Body("bolt", BodyKind.MOVABLE, shapes, pose())
    lock = [
        box("top_a", (0.3, 0.14, 0.03), (-0.6, 0.25, 0.208)),
        box("top_b", (0.2, 0.14, 0.03), (0.1, 0.25, 0.208)),
        box("back", (0.95, 0.03, 0.14), (-0.275, 0.15, 0.12)),
        box("front_a", (0.3, 0.03, 0.14), (-0.6, 0.35, 0.12)),
        box("rib", (0.1, 0.03, 0.14), (-0.2, 0.35, 0.12)),
        box("front_b", (0.2, 0.03, 0.14), (0.1, 0.35, 0.12)),
        box("roof", (0.1, 0.05, 0.03), (-0.2, 0.34, 0.208)),
    ]
    problem = ObjectPathProblem(bolt, pose((-0.32, 0.4, 0.12)), pose((-0.1, 0.4, 0.12)), (TABLE, *lock))
    path = plan(problem)
    check_ends_of(path, problem)
    assert worst_distance(bolt, path.poses, (TABLE, *lock), radius=0.3) > 0.0
    assert 2 <= len(path.cuts) <= 6


@pytest.mark.parametrize(
    "change", [{"motion": "sideways"}, {"min_distance": -1.0}, {"start": np.zeros(7)}, {"goal": np.full(7, np.nan)}]
)
def test_bad_problems_are_refused(change):
    good = {"start": pose((0, 0, 0.09)), "goal": pose((0.1, 0, 0.09)), "obstacles": (TABLE,)}
    with pytest.raises(InputError):
        ObjectPathProblem(BAR, **{**good, **change})
