"""Obstacles that have to go first: what is removed, in which order, how deep, and what is said when one cannot go."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from obstacle_fixtures import corridor, crowded, eight, gap, heavy_slab, side_door, task, tower

from hmap_core.exceptions import Code, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner import HmapPlanner, PlanningJob, plan
from hmap_core.planner.obstacle_removal import (
    PLACES_BLOCKED,
    PLACES_BY_STAGES,
    PLACES_UNREACHED,
    ObstacleRemoval,
    RemovalError,
    blocked,
)
from hmap_core.planner.outcome import Failure, Solution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.remove_obstacles import nearest_first
from hmap_core.types import Goal
from hmap_core.validation import check

TIME_LIMIT = 120.0  # s; a busy machine is slow


def moved(made) -> list[str]:
    """The movable bodies in the order in which they are last let go of."""
    order = {s.object: s.end for s in made.segments if s.object}
    return sorted(order, key=order.get)


def assert_valid(made, removed: int, depth: int = 1) -> None:
    """The judge accepts the whole plan, and it says how much had to go."""
    report = check(to_dict(made))
    assert report.valid, report.violations[:3]
    assert (made.stats["removals"], made.stats["removal_depth"]) == (removed, depth)
    assert len(moved(made)) == removed + 1 and moved(made)[-1] == made.scene.goal.object


@pytest.mark.parametrize("mode", ["physical", "kinematic"])
def test_one_of_two_boxes_in_a_gap_is_removed(tmp_path, mode):
    made = plan(gap(tmp_path, mode=mode), seed=1, time_limit=TIME_LIMIT)
    assert_valid(made, removed=1)


def test_a_given_place_is_taken(tmp_path):
    removable = {"one": (0.3, 0.4, 0.04), "two": (0.7, 0.4, 0.04)}
    scene = gap(tmp_path, removable)
    made = plan(scene, seed=1, time_limit=TIME_LIMIT)
    assert_valid(made, removed=1)
    name = moved(made)[0]
    np.testing.assert_allclose(made.trajectory.objects[name][-1], scene.removable[name], atol=1e-3)


def test_a_given_place_that_is_taken_gives_way_to_a_computed_one(tmp_path):
    made = plan(gap(tmp_path, {"one": (0.9, 0.25, 0.04), "two": (0.9, 0.25, 0.04)}), seed=1, time_limit=TIME_LIMIT)
    assert_valid(made, removed=1)


def test_a_tower_is_taken_down_from_its_top(tmp_path):
    made = plan(tower(tmp_path), seed=1, time_limit=TIME_LIMIT)
    assert_valid(made, removed=2, depth=2)
    assert moved(made) == ["upper", "lower", "brick"]


def test_what_the_path_meets_first_goes_first(tmp_path):
    made = plan(corridor(tmp_path), seed=1, time_limit=TIME_LIMIT)
    assert_valid(made, removed=2)
    assert moved(made) == ["outer", "inner", "brick"]


def test_what_blocks_only_an_obstacle_is_removed_for_its_sake(tmp_path):
    made = plan(side_door(tmp_path), seed=0, time_limit=TIME_LIMIT)
    assert_valid(made, removed=2, depth=2)
    assert moved(made) == ["outer", "inner", "brick"]


def test_boxes_in_the_hands_way_are_removed_though_the_object_could_pass(tmp_path):
    scene = crowded(tmp_path, motion="auto")
    made = plan(scene, seed=0, time_limit=TIME_LIMIT)
    assert_valid(made, removed=made.stats["removals"])
    assert 1 <= made.stats["removals"] < 4


def test_of_eight_boxes_only_the_two_in_the_way_go(tmp_path):
    job = PlanningJob(HmapPlanner(), eight(tmp_path), seed=1, time_limit=TIME_LIMIT)
    made = job.plan()
    assert_valid(made, removed=2)
    assert set(moved(made)) == {"box_0", "box_1", "brick"}
    assert job.search.removal.begun == 2


def test_an_obstacle_that_cannot_be_moved_is_named(tmp_path):
    seen = []
    with pytest.raises(PlannerError, match="'slab' is in the way of 'brick' and cannot be removed: .*slab") as error:
        plan(heavy_slab(tmp_path, motion="auto"), seed=1, time_limit=TIME_LIMIT, progress=seen.append)
    assert (error.value.stage, error.value.code) == ("planner", Code.NO_CONTACT)
    assert "'slab', which is 80 mm wide" in error.value.reason and "opens 78 mm" in error.value.reason
    assert "path of 'slab' out of the way of 'brick'" not in [p.text for p in seen]  # known before any search


def test_a_body_that_may_not_be_moved_keeps_what_carries_it(tmp_path):
    boxes = {"lower": ((0.06, 0.14, 0.06), (0.5, 0.25, 0.03)), "upper": ((0.05, 0.05, 0.05), (0.5, 0.29, 0.085))}
    start, goal = (0.5, -0.1, 0.04), (0.5, 0.2, 0.04)
    scene = task(tmp_path, "A load that stays.", {}, boxes, {"lower": None}, start, goal)
    with pytest.raises(PlannerError, match="'lower' is in the way of 'brick'.*'lower' carries 'upper'"):
        plan(scene, seed=1, time_limit=TIME_LIMIT)


def test_the_same_seed_removes_alike(tmp_path):
    scene = gap(tmp_path)
    first, second = (plan(scene, seed=3, time_limit=TIME_LIMIT) for _ in range(2))
    for name, poses in first.trajectory.objects.items():
        np.testing.assert_array_equal(poses, second.trajectory.objects[name])


class Scripted:
    """A search that brings a body only once all that bars its way has gone, and says what it was asked."""

    def __init__(self, scene, bars: dict[str, set[str]]):
        self.context, self.bars = SimpleNamespace(scene=scene, rng=np.random.default_rng(0)), bars
        self.asked: list[str] = []

    def bring(self, subgoal, sequence):
        name = subgoal.goal.object
        self.asked.append(name)
        left = self.bars.get(name, set()) - set(sequence.aside)
        if left:
            return Failure.of(PlannerError(f"'{name}' is stuck behind {', '.join(sorted(left))}", Code.NO_MOTION))
        state = sequence.state.copy()
        state.poses[name] = subgoal.goal.pose
        return Solution(replace(sequence, state=state))


def cleared(scene, bars) -> tuple[SolutionSequence, Scripted, ObstacleRemoval]:
    planner = Scripted(scene, bars)
    removal = ObstacleRemoval(planner)
    solution = removal.clear(Subgoal(scene.goal), SolutionSequence(scene.start_state()), list(scene.removable), ())
    return solution, planner, removal


def test_what_cannot_go_yet_goes_last(tmp_path):
    scene = eight(tmp_path)
    names = list(scene.removable)
    bars = {name: {after} for name, after in zip(names, names[1:], strict=False)}
    solution, _, removal = cleared(scene, bars)
    assert solution.aside == tuple(reversed(names))
    assert removal.begun <= len(names) ** 2


def test_a_circle_of_obstacles_ends_with_a_reason_after_few_tries(tmp_path):
    scene = eight(tmp_path)
    names = list(scene.removable)
    planner = Scripted(scene, {name: set(names) - {name} for name in names})
    removal = ObstacleRemoval(planner)
    with pytest.raises(RemovalError, match="cannot be removed: 'box_7' is stuck behind box_0"):
        removal.clear(Subgoal(scene.goal), SolutionSequence(scene.start_state()), names, ())
    assert removal.begun == len(names)


def test_time_that_is_up_ends_the_clearing_at_once(tmp_path):
    scene = eight(tmp_path)
    planner = Scripted(scene, {})

    def late(subgoal, sequence):
        planner.asked.append(subgoal.goal.object)
        raise PlannerError("time is up", Code.TIME_LIMIT)

    planner.bring = late
    with pytest.raises(PlannerError, match="time is up"):
        ObstacleRemoval(planner).clear(
            Subgoal(scene.goal), SolutionSequence(scene.start_state()), ["box_0", "box_1"], ()
        )
    assert planner.asked == ["box_0"]


def test_a_subgoal_that_must_manage_alone_removes_nothing(tmp_path):
    scene = eight(tmp_path)
    planner = Scripted(scene, {})
    subgoal = Subgoal(Goal("box_2", scene.bodies["box_2"].pose), depth=1, alone=True)
    with pytest.raises(RemovalError, match="'box_0' is in the way of 'box_2'"):
        ObstacleRemoval(planner).clear(subgoal, SolutionSequence(scene.start_state()), ["box_0"], ())
    assert planner.asked == []


class Covered(Scripted):
    """As Scripted; a body that others bar says so, as if hands fit on it only without these."""

    def bring(self, subgoal, sequence):
        outcome = super().bring(subgoal, sequence)
        if isinstance(outcome, Failure) and subgoal.alone:
            return Failure.of(blocked(subgoal, next(iter(self.bars[subgoal.goal.object]))), ends_round=True)
        return outcome


def test_a_body_that_others_cover_waits_for_them(tmp_path):
    """It was tried at all its places, and then others were removed for its sake, before those in front of it went."""
    scene = eight(tmp_path)
    planner = Covered(scene, {"box_0": {"box_1"}})
    removal = ObstacleRemoval(planner)
    solution = removal.clear(Subgoal(scene.goal), SolutionSequence(scene.start_state()), ["box_0", "box_1"], ())
    assert solution.aside == ("box_1", "box_0")
    assert planner.asked == [*["box_0"] * PLACES_BLOCKED, "box_1", "box_0"]


class Stuck:
    """A strategy that notes a body on the path of object and hand, and one after it that fails otherwise."""

    name = "stuck"

    def __init__(self, error=None):
        self._error = error

    def applies(self, task):
        return True

    def solve(self, search, task):
        if self._error is not None:
            task.blocked = Failure.of(self._error, ends_round=True)
        return Failure.of(PlannerError("the arm does not reach it", Code.NO_MOTION))


@pytest.mark.parametrize("others", [False, True])
def test_a_body_on_the_path_of_a_hand_is_told_though_other_strategies_fail_otherwise(tmp_path, monkeypatch, others):
    """What was behind others counted as stuck, and was tried at all its places before these were removed."""
    scene = eight(tmp_path)
    subgoal = Subgoal(Goal("box_2", scene.bodies["box_2"].pose), depth=1, alone=True)
    error = blocked(subgoal, "box_1") if others else None
    monkeypatch.setattr("hmap_core.planner.search.PATH_STRATEGIES", (Stuck(error), Stuck()))
    search = PlanningJob(HmapPlanner(), scene, seed=1).search
    outcome = search.round(subgoal, SolutionSequence(scene.start_state()), 0)
    assert outcome.ends_round == others and (outcome.error is error) == others


def test_of_bodies_one_behind_the_other_the_nearest_to_the_robot_goes_first(tmp_path):
    """The object met the farthest first, as it came from behind them."""
    scene = eight(tmp_path)
    state = scene.start_state()
    base = next(iter(scene.robots.values())).base_pose[:3]
    for name, away in (("box_0", 0.7), ("box_1", 0.5), ("box_2", 0.505)):
        state.poses[name] = np.r_[base + (away, 0.0, 0.0), state.poses[name][3:]]
    sequence = SolutionSequence(state)
    assert nearest_first(scene, sequence, ("box_0", "box_2", "box_1")) == ("box_2", "box_1", "box_0")


def test_a_body_without_any_contact_is_not_tried_at_many_places(tmp_path):
    scene = eight(tmp_path)
    planner = Scripted(scene, {})

    def bring(subgoal, sequence):
        planner.asked.append(subgoal.goal.object)
        return Failure.of(PlannerError("none of 500 contacts is reachable", Code.NO_CONTACT))

    planner.bring = bring
    with pytest.raises(RemovalError, match="none of 500 contacts"):
        ObstacleRemoval(planner).clear(Subgoal(scene.goal), SolutionSequence(scene.start_state()), ["box_0"], ())
    assert len(planner.asked) <= PLACES_UNREACHED + PLACES_BY_STAGES
