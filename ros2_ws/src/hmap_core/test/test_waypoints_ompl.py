"""Object paths by planners of OMPL: the same answers as of hmap's own search, verified by another library."""

import subprocess
import sys

import numpy as np
import pytest
from geometry_fixtures import TABLE, box, worst_distance
from waypoints_fixtures import SLACK, U_WALLS, WINDOW, two_doors_problem, u_problem, window_problem

from hmap_core.exceptions import Code, InputError
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.scenes.loader import load_scene
from hmap_core.transforms import distance, pose
from hmap_core.types import BodyKind
from hmap_core.waypoints import DEFAULT_MIN_DISTANCE, NoObjectPath, ObjectPathProblem
from hmap_core.waypoints.checker import Geometry, ObjectChecker
from hmap_core.waypoints.ompl_planner import MAX_CORNERS, plan_waypoints_ompl, thinned
from hmap_core.waypoints.ompl_solver import UNUSABLE, known_planner, planner_names
from hmap_core.waypoints.resample import POSITION_STEP, ROTATION_STEP

PLANNERS = ("RRTConnect", "BITstar", "AITstar", "KPIECE1")
TIME_LIMIT = 120.0  # s; a search ends by its checks long before
CHECKS = 60_000


def plan(name, problem, seed=0, limit=TIME_LIMIT, checks=CHECKS):
    return plan_waypoints_ompl(name, problem, np.random.default_rng(seed), limit, checks)


def check_shape_of(path, problem):
    assert max(distance(path.poses[0], problem.start)) < 1e-12
    assert max(distance(path.poses[-1], problem.goal)) < 1e-12
    steps = np.array([distance(a, b) for a, b in zip(path.poses[:-1], path.poses[1:], strict=True)])
    assert steps[:, 0].max() <= POSITION_STEP + 1e-9 and steps[:, 1].max() <= ROTATION_STEP + 1e-9
    assert np.all(np.diff(path.cuts) > 0) and path.cuts[-1] == len(path.poses) - 1
    assert path.clearance.shape == (len(path.poses),)


@pytest.mark.parametrize("name", PLANNERS)
def test_round_a_u_in_the_plane(name):
    problem = u_problem()
    path = plan(name, problem)
    check_shape_of(path, problem)
    assert path.motion == "planar"
    np.testing.assert_allclose(path.poses[:, 2], 0.1, atol=1e-12)
    assert worst_distance(problem.body, path.poses, U_WALLS, radius=0.14) > 5e-4 - SLACK
    assert path.clearance.min() > 5e-4 - SLACK


@pytest.mark.parametrize("name", PLANNERS)
def test_through_a_window_in_space(name):
    problem = window_problem()
    path = plan(name, problem)
    check_shape_of(path, problem)
    assert path.motion == "spatial"
    assert worst_distance(problem.body, path.poses, (TABLE, *WINDOW), radius=0.14) > 5e-4 - SLACK


def test_wide_paths_keep_the_minimum_distance():
    problem = window_problem()
    path = plan("RRTConnect", problem)
    assert worst_distance(problem.body, path.poses, (TABLE, *WINDOW), radius=0.14) > DEFAULT_MIN_DISTANCE - SLACK


@pytest.mark.parametrize("name", PLANNERS)
def test_same_seed_gives_the_same_path_whatever_was_planned_before(name):
    problem = window_problem()
    first = plan(name, problem, 7)
    other = plan("RRTConnect", u_problem(), 3)
    again = plan(name, problem, 7)
    np.testing.assert_array_equal(first.poses, again.poses)
    np.testing.assert_array_equal(first.cuts, again.cuts)
    assert len(other.poses) != len(first.poses)
    assert not np.array_equal(plan(name, problem, 8).poses, first.poses)


@pytest.mark.parametrize("name", ["KPIECE1", "LBKPIECE1", "PDST", "EITstar", "LBTRRT"])
def test_planners_with_other_needs(name):
    """Those that ask how far a blocked motion is free, check states alone, or do not end by themselves."""
    problem = u_problem()
    path = plan(name, problem)
    assert worst_distance(problem.body, path.poses, U_WALLS, radius=0.14) > 5e-4 - SLACK


def test_bitstar_plans_the_published_tunnel():
    scene = load_scene("published/tunnel")
    state, goal = scene.start_state(), scene.goal
    others = placed_bodies(scene, state, goal.object)
    problem = ObjectPathProblem(scene.bodies[goal.object], state.poses[goal.object], goal.pose, others, scene.motion)
    path = plan("BITstar", problem)
    check_shape_of(path, problem)
    walls = [body for body in others if body.kind == BodyKind.FIXED]
    assert worst_distance(problem.body, path.poses, walls) > -1e-3


def test_no_path_names_what_blocks_and_what_has_to_go():
    walls = [box(f"wall{s}", (0.05, 1.2, 0.3), (0, s * 0.65, 0.2)) for s in (-1, 1)]
    cube = box("cube", (0.05, 0.09, 0.1), (0, 0, 0.1), kind=BodyKind.MOVABLE)
    bystander = box("bystander", (0.05, 0.05, 0.1), (-0.3, 0.3, 0.1), kind=BodyKind.MOVABLE)
    edge = [box(f"edge{s}", (2.0, 0.05, 0.3), (0, s * 1.25, 0.2)) for s in (-1, 1)]
    ends = [box(f"end{s}", (0.05, 2.6, 0.3), (s, 0, 0.2)) for s in (-1, 1)]
    problem = ObjectPathProblem(
        box("brick", (0.08, 0.08, 0.1), (0, 0, 0)), pose((-0.4, 0, 0.1)), pose((0.4, 0, 0.1)),
        (TABLE, *walls, *edge, *ends, cube, bystander), motion="planar", removable=frozenset({"cube", "bystander"}),
    )  # fmt: skip
    with pytest.raises(NoObjectPath) as error:
        plan("RRTConnect", problem)
    assert error.value.code == Code.NO_OBJECT_PATH
    assert error.value.blockers[0] == "cube"
    assert error.value.free_without == ("cube",)
    check_shape_of(error.value.path_without, problem)


def test_two_doors_name_the_fewest_bodies():
    problem = two_doors_problem()
    with pytest.raises(NoObjectPath) as error:
        plan("RRTConnect", problem)
    assert sorted(error.value.free_without) == ["b0", "b1"]


def test_a_search_ends_by_its_checks():
    """A cube in a cage too tight for the proof that there is no way: the search gives up after what it may check."""
    wall = box("wall", (0.05, 4.0, 3.0), (0.0, 0.0, 1.5))
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    problem = ObjectPathProblem(cube, pose((-0.4, 0, 0.1)), pose((0.4, 0, 0.1)), (TABLE, wall), motion="spatial")
    with pytest.raises(NoObjectPath) as error:
        plan("RRTConnect", problem, checks=3000)
    assert error.value.blockers[0] == "wall" and error.value.free_without is None


def test_an_end_in_collision_is_refused():
    block = box("block", (0.1, 0.1, 0.1), (0.0, 0.0, 0.1))
    cube = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    problem = ObjectPathProblem(cube, pose((-0.08, 0, 0.1)), pose((0.5, 0, 0.1)), (TABLE, block))
    with pytest.raises(InputError) as error:
        plan("RRTConnect", problem)
    assert error.value.code == Code.START_IN_COLLISION


def test_unknown_planners_are_refused_with_those_that_are_there():
    with pytest.raises(InputError, match=r"planner 'ompl:RRTConect' is unknown; allowed: .*BITstar.*RRTConnect"):
        plan("RRTConect", u_problem())
    with pytest.raises(InputError, match="planner 'ompl:SPARS' cannot be used here: it checks motions from a second"):
        plan("ompl:SPARS", u_problem())
    assert known_planner("ompl:AITstar") == known_planner("AITstar") == "AITstar"
    assert set(PLANNERS) < set(planner_names()) and not set(UNUSABLE) & set(planner_names())


def test_long_paths_are_thinned():
    problem = u_problem()
    checker = ObjectChecker(problem, Geometry(problem), True, DEFAULT_MIN_DISTANCE)
    along = np.array([pose((-0.25, -0.3 + y, 0.1)) for y in np.linspace(0.0, 0.5, MAX_CORNERS + 10)])
    np.testing.assert_array_equal(thinned(checker, along), along[[0, -1]])
    np.testing.assert_array_equal(thinned(checker, along[:MAX_CORNERS]), along[:MAX_CORNERS])


def test_errors_in_checks_come_out(monkeypatch):
    """What a check raises, an interrupt for instance, ends the search; the next one is not disturbed."""
    problem = u_problem()
    before = plan("RRTConnect", problem)
    with monkeypatch.context() as patch:
        patch.setattr(ObjectChecker, "motion_free", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            plan("RRTConnect", problem)
    np.testing.assert_array_equal(plan("RRTConnect", problem).poses, before.poses)


SILENT = """
import sys
import numpy as np
from waypoints_fixtures import window_problem
from hmap_core.waypoints.ompl_planner import plan_waypoints_ompl
assert not any(name.split(".")[0] == "ompl" for name in sys.modules), "imported before it is needed"
for name in ("RRTConnect", "BITstar"):
    plan_waypoints_ompl(name, window_problem(), np.random.default_rng(0), 120.0)
import coal
coal.Box(1, 1, 1)
"""


def test_nothing_is_printed_and_the_process_ends_well(request):
    done = subprocess.run(
        [sys.executable, "-c", SILENT], cwd=request.path.parent, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
