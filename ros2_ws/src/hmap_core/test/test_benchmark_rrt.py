"""The judge of object paths against paths that are wrong in one way each; both sides on a few instances."""

import numpy as np
import pytest

from hmap_core.benchmark import rrt
from hmap_core.benchmark.problems.object_path import TUNNEL_CLEARANCE, se2, se3
from hmap_core.transforms import multiply, pose
from hmap_core.validation import rigid

TRAP, TUNNEL = 0, 1


def shifted(T, x=0.0, y=0.0, z=0.0):
    return T + np.array([x, y, z, 0, 0, 0, 0])


def turned(T, yaw):
    return multiply(T, pose((0, 0, 0), (0, 0, np.sin(yaw / 2), np.cos(yaw / 2))))


def test_the_same_seed_gives_the_same_instance():
    for make in (se2, se3):
        assert np.array_equal(make(4).start, make(4).start)
        assert not np.array_equal(make(4).start, make(6).start)


@pytest.mark.parametrize(("make", "seed"), [(se2, TRAP), (se2, TUNNEL), (se3, 0)])
def test_ends_are_free_and_the_straight_way_is_not(make, seed):
    problem = make(seed)
    for T in (problem.start, problem.goal):
        R, p = rigid.matrices(T[3:])[None], T[:3][None]
        assert all(rrt._penetration(problem.body, R, p, body) == 0.0 for body in problem.obstacles)
    wrong = rrt.judge(problem, np.array([problem.start, problem.goal]))
    assert wrong and all("penetrates" in text for text in wrong)


def test_wrong_ends_and_leaving_the_plane_are_seen():
    problem = se2(TUNNEL)
    goal = problem.goal
    inside = [goal, shifted(goal, x=0.01), goal]
    assert rrt.judge(problem, np.array(inside)) == ["its start is not the problem's"]
    wrong = rrt.judge(problem, np.array([problem.start, shifted(problem.start, x=-0.01)]))
    assert wrong == ["its end is not the problem's"]
    wrong = rrt.judge(problem, np.array([goal, shifted(goal, z=0.01), goal]))
    assert "it leaves the plane" in wrong


def test_the_judge_allows_a_millimetre_and_no_more():
    problem = se2(TUNNEL)
    goal = problem.goal
    for depth, bad in ((0.0009, False), (0.0011, True)):
        aside = shifted(goal, y=TUNNEL_CLEARANCE + depth)
        wrong = rrt.judge(problem, np.array([goal, aside, goal]))
        assert any("'upper'" in text for text in wrong) == bad


def test_what_happens_between_two_poses_counts():
    problem = se2(TUNNEL)
    goal = problem.goal
    wrong = rrt.judge(problem, np.array([goal, turned(goal, 3.0)]))  # free at both ends almost
    assert any("'upper'" in text for text in wrong) and any("'lower'" in text for text in wrong)


@pytest.mark.parametrize(("make", "seed"), [(se2, TRAP), (se2, TUNNEL), (se3, 1)])
def test_our_paths_are_verified(make, seed):
    problem = make(seed)
    first, again = (rrt.solve_hmap(problem, rrt.prepare_hmap(problem)) for _ in range(2))
    assert first.claimed
    assert rrt.judge(problem, first.path) == []
    np.testing.assert_array_equal(first.path, again.path)


@pytest.mark.parametrize(("make", "seed"), [(se2, TRAP), (se2, TUNNEL), (se3, 1)])
def test_ompl_paths_are_verified(make, seed):
    problem = make(seed)
    first, again = (rrt.solve_ompl(problem, rrt.prepare_hmap(problem)) for _ in range(2))
    assert first.claimed
    assert rrt.judge(problem, first.path) == []
    np.testing.assert_array_equal(first.path, again.path)


@pytest.mark.parametrize(("make", "seed"), [(se2, TRAP), (se2, TUNNEL), (se3, 1)])
def test_rai_is_asked_the_same(make, seed):
    pytest.importorskip("robotic", exc_type=ImportError)
    problem = make(seed)
    answer = rrt.solve_rai(problem, rrt.prepare_rai(problem))
    assert answer.claimed
    assert rrt.judge(problem, answer.path) == []
