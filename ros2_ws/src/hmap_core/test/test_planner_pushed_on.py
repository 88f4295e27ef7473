"""Pushes that go on from where the object was brought, instead of from the start, and in other directions."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.exceptions import Code
from hmap_core.planner import HmapPlanner, PlanningJob
from hmap_core.planner.outcome import Failure, Solution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.pushed_around import PushedAround
from hmap_core.planner.strategies.pushed_on import PushedOn
from hmap_core.planner.tasks import PathTask
from hmap_core.transforms import pose
from hmap_core.types import Goal
from hmap_core.waypoints.resample import direction

WIDE = 0.09  # m, wider than a Panda's gripper opens
START, HALF_WAY, GOAL = ((x, 0.2 - x / 2, WIDE / 2) for x in (0.4, 0.5, 0.6))


class Following:
    """A search that brings the object on by the first try from each place, and then to its goal."""

    def __init__(self, context, ends_at=(HALF_WAY, GOAL)):
        self.context, self.ends, self.began = context, list(ends_at), []
        self.at = None  # where the object was at the last try

    def follow(self, subgoal, sequence, poses, known=None):
        object = subgoal.goal.object
        self.began.append(tuple(np.round(sequence.state.poses[object][:2], 3)))
        np.testing.assert_allclose(poses[0], sequence.state.poses[object], atol=1e-9)
        again, self.at = self.at == self.began[-1], self.began[-1]
        end = None if again or not self.ends else self.ends.pop(0)
        if end is None:
            return Failure("contacts", Code.NO_CONTACT, "none")
        reached = moved(sequence, object, end)
        if end == GOAL:
            return Solution(reached)
        return Failure("contacts", Code.NO_CONTACT, "none", reached=reached)


def moved(sequence, object, end):
    state = sequence.state.copy()
    state.poses[object] = np.concatenate([end, state.poses[object][3:]])
    return replace(sequence, state=state)


def job(width: float = WIDE):
    made = scene(box("cube", (width, width, WIDE), START), goal=Goal("cube", pose(GOAL), 0.02, np.pi))
    return PlanningJob(HmapPlanner(), made)


def task_of(own, reached) -> PathTask:
    return PathTask(Subgoal(own.scene.goal), SolutionSequence(own.start), 0, reached=reached)


def test_it_begins_where_the_object_was_brought():
    own = job()
    search = Following(own.context)
    task = task_of(own, moved(SolutionSequence(own.start), "cube", (0.45, -0.03, WIDE / 2)))
    assert PushedOn().applies(task)
    outcome = PushedOn().solve(search, task)
    assert isinstance(outcome, Solution)
    assert search.began[0] == (0.45, -0.03) and search.began[-1] == tuple(np.round(HALF_WAY[:2], 3))
    np.testing.assert_allclose(outcome.sequence.state.poses["cube"][:3], GOAL)


def test_it_ends_where_no_push_brings_the_object_on():
    own = job()
    search = Following(own.context, ())
    assert isinstance(PushedOn().solve(search, task_of(own, SolutionSequence(own.start))), Failure)
    assert 1 <= len(search.began) <= 3


def test_what_a_hand_grips_is_left_to_grasps():
    own = job(0.05)
    search = Following(own.context)
    PushedOn().solve(search, task_of(own, SolutionSequence(own.start)))
    assert search.began == []


@pytest.mark.parametrize("reached", [False, True])
def test_a_path_that_ends_half_way_tells_what_was_reached(monkeypatch, reached):
    own = job()
    goal = own.scene.goal
    there = moved(SolutionSequence(own.start), "cube", HALF_WAY)
    outcomes = [Solution(there, reach=1)] if reached else []

    def run(strategies, task):
        return outcomes.pop(0) if outcomes else Failure("contacts", Code.NO_CONTACT, "none")

    monkeypatch.setattr(own.search, "run", run)
    poses = np.array([pose(START), pose(HALF_WAY), pose(GOAL)])
    outcome = own.search.follow(Subgoal(goal), SolutionSequence(own.start), poses)
    assert isinstance(outcome, Failure) and outcome.reached is (there if reached else None)
    assert outcome.at == (1 if reached else 0)


class PushedAside:
    """A search that follows paths as long as the object does not move along the x axis."""

    def __init__(self, context):
        self.context, self.tried = context, []

    def follow(self, subgoal, sequence, poses, known=None):
        self.tried.append(poses)
        steps = np.diff(poses[:, :2], axis=0)
        ahead = (steps[:, 0] > 0.002) & (np.abs(steps[:, 1]) < 0.2 * steps[:, 0])
        if ahead.any():
            return Failure("contacts", Code.NO_CONTACT, "none", at=int(ahead.argmax()))
        np.testing.assert_allclose(poses[0], sequence.state.poses[subgoal.goal.object], atol=1e-9)
        state = sequence.state.copy()
        state.poses[subgoal.goal.object] = poses[-1]
        return Solution(replace(sequence, state=state))


def straight_task(own) -> PathTask:
    poses = np.linspace(own.start.poses["cube"], np.r_[GOAL, own.start.poses["cube"][3:]], 30)
    return PathTask(
        Subgoal(own.scene.goal), SolutionSequence(own.start), 0, poses=poses, ready=SolutionSequence(own.start)
    )


def test_what_is_not_pushed_in_one_direction_is_turned_and_pushed_in_others():
    own = job()
    search, task = PushedAside(own.context), straight_task(own)
    assert not PushedAround().applies(task)
    task.stopped(
        Failure("contacts", Code.NO_CONTACT, "none", at=3), np.array([pose((0.01 * k, 0, 0)) for k in range(9)])
    )
    assert task.unserved == [0.0] and PushedAround().applies(task)
    outcome = PushedAround().solve(search, task)
    assert isinstance(outcome, Solution)
    np.testing.assert_allclose(outcome.sequence.state.poses["cube"][:3], GOAL, atol=1e-6)


def test_legs_are_pushed_one_by_one():
    """A motion of the joints that does not stop swings out where a straight push becomes an arc, and slips."""
    own = job()
    search, task = PushedAside(own.context), straight_task(own)
    task.unserved.append(0.0)
    assert isinstance(PushedAround().solve(search, task), Solution)
    assert len(search.tried) > 2
    for leg in search.tried:
        steps = [direction(a, b, WIDE) for a, b in zip(leg[:-1], leg[1:], strict=True)]
        assert all(a @ b > np.cos(np.deg2rad(10.0)) for a, b in zip(steps[:-1], steps[1:], strict=True))


def test_a_path_that_was_not_followed_tells_no_direction():
    task = straight_task(job())
    task.stopped(Failure("planner", Code.NO_CONTACT, "an obstacle stays"), task.poses)
    assert task.unserved == []


def test_what_a_hand_grips_is_not_pushed_around():
    own = job(0.05)
    search, task = PushedAside(own.context), straight_task(own)
    task.unserved.append(0.0)
    assert isinstance(PushedAround().solve(search, task), Failure) and search.tried == []
