"""A blocked plan is repaired: what is free is kept, what is new is valid, and both make one valid plan."""

from dataclasses import replace

import numpy as np
import pytest
from replan_fixtures import FAR, brick_plan, on_the_way_to_the_contact, with_body

from hmap_core import planner, transforms
from hmap_core.exceptions import HmapError
from hmap_core.plan_file import to_dict
from hmap_core.planner.conflicts import first_conflict
from hmap_core.planner.interruption import contacts, held_pose, release
from hmap_core.planner.planned_subgoals import planned_subgoals
from hmap_core.planner.repair import PlanRepair, plan_anew, rehearse
from hmap_core.simulation.dynamic import sphere
from hmap_core.trajectory.samples import state_at
from hmap_core.validation import check

NUDGE = 0.002  # m


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return brick_plan(tmp_path_factory)


def repaired(plan, scene, state, at=0.0):
    """The new plan, which the judge accepts as a whole, and what was kept."""
    repair = PlanRepair(planner.PlanningJob(planner.HmapPlanner(), scene, state, seed=3), plan, at)
    new = repair.repair()
    report = check(to_dict(new))
    assert report.valid, report.violations
    return new, {how: count for how, count in repair.kept.items() if count}


def start_with(plan, body):
    state = state_at(plan, 0)
    state.poses[body.name] = body.pose
    return with_body(plan, body), state


def on_the_way_of_the_brick(plan):
    """A small ball that only the brick and the hand with it run into."""
    made = contacts(plan)[0]
    poses = plan.trajectory.objects["brick"]
    body = sphere("ball", 0.02, [*poses[(made.begin + made.end) // 2][:2], 0.025])
    assert first_conflict(plan, {"ball": body}, objects=["brick"], robots=()) is not None
    return body


def test_subgoals_cover_a_plan_and_end_with_free_hands(plan):
    subgoals = planned_subgoals(plan)
    assert [subgoal.bodies for subgoal in subgoals] == [{"brick"}] * len(subgoals)
    assert subgoals[0].first == 0 and subgoals[-1].last == len(plan.trajectory.time) - 1
    assert all(a.last == b.first for a, b in zip(subgoals, subgoals[1:], strict=False))


def test_what_is_free_is_followed_as_it_was(plan):
    new, kept = repaired(plan, *start_with(plan, FAR))
    assert kept == {"motions": len(planned_subgoals(plan))}
    assert np.allclose(new.trajectory.joints["arm"], plan.trajectory.joints["arm"])


def test_only_a_blocked_way_to_a_contact_is_planned_anew(plan):
    made = contacts(plan)[0]
    new, kept = repaired(plan, *start_with(plan, on_the_way_to_the_contact(plan)))
    assert kept["work"] == 1 and "paths" not in kept and "planned" not in kept
    work = plan.trajectory.joints["arm"][made.begin :]
    assert np.allclose(new.trajectory.joints["arm"][-len(work) :], work)
    assert not np.allclose(
        new.trajectory.joints["arm"][: made.begin // 2], plan.trajectory.joints["arm"][: made.begin // 2]
    )


def test_an_object_that_was_nudged_is_taken_by_its_old_contact(plan):
    state = state_at(plan, 0)
    state.poses["brick"] = state.poses["brick"] + NUDGE * np.eye(7)[0]
    new, kept = repaired(plan, plan.scene, state)
    assert kept["contacts"] == 1
    assert new.segments[1].contact_pose == pytest.approx(contacts(plan)[0].segment.contact_pose, abs=1e-3)


def test_a_hand_that_had_to_let_go_takes_up_its_contact_again(plan):
    made = contacts(plan)[0]
    k = (made.begin + made.end) // 2
    state = state_at(plan, k)
    opening, motion = release(plan.scene, state, plan, made)
    state.poses["brick"] = held_pose(plan.scene, state, made)
    state.q["arm"], state.gripper["arm"] = motion.positions[-1], opening
    new, kept = repaired(plan, plan.scene, state, float(plan.trajectory.time[k]))
    assert kept["contacts"] == 1
    np.testing.assert_allclose(new.trajectory.objects["brick"][0], state.poses["brick"])


def test_an_object_whose_path_is_blocked_goes_another_way(plan):
    body = on_the_way_of_the_brick(plan)
    new, kept = repaired(plan, *start_with(plan, body))
    assert kept["paths"] == 1
    assert first_conflict(plan, {"ball": body}) is not None
    moved, _ = transforms.distance(new.trajectory.objects["brick"][-1], plan.scene.goal.pose)
    assert moved <= plan.scene.goal.position_tolerance


def test_where_nothing_of_the_plan_is_left_algorithm_1_plans(plan):
    state, end = state_at(plan, 0), float(plan.trajectory.time[-1])
    with pytest.raises(HmapError, match="nothing of the old plan is left"):
        repaired(plan, plan.scene, state, end)
    new, kept = plan_anew(plan, end, plan.scene, state, 1)
    assert kept == {} and check(to_dict(new)).valid


def test_a_plan_to_another_goal_cannot_be_repaired(plan):
    goal = replace(plan.scene.goal, pose=plan.scene.goal.pose + 0.1 * np.eye(7)[0])
    with pytest.raises(HmapError, match="from its goal"):
        repaired(plan, plan.scene.with_goal(goal), state_at(plan, 0))


def test_a_rehearsal_changes_nothing(plan):
    before = to_dict(plan)
    rehearse(plan, 30.0)
    assert to_dict(plan) == before
