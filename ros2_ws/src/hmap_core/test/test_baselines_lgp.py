"""LGP: actions, bounds, and the contract of methods."""

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.baselines.lgp.actions import Action, Hand, Target, successors, support_of
from hmap_core.baselines.lgp.bounds import blockers, contacts_at_switches, target_pose
from hmap_core.baselines.lgp.paths import BoundedAction, runs_of
from hmap_core.exceptions import Code, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.scenes import load_scene
from hmap_core.transforms import IDENTITY
from hmap_core.types import ContactKind, ContactPoint
from hmap_core.validation import check

SEED = 1


@pytest.fixture(scope="module")
def scene():
    return load_scene("published/puck_move", 0)


def test_every_removable_body_moves_once_and_nothing_follows_the_goal(scene):
    hand = Hand("panda", scene)
    first = list(successors(scene, scene.goal, [], [hand]))
    assert {(own.object, own.target) for own in first} == {
        ("cube", Target.GOAL), ("cube", Target.PLACE), *((f"obstacle_{k}", Target.REMOVAL) for k in (1, 2, 3)),
    }  # fmt: skip
    removal = Action(hand, "obstacle_1", Target.REMOVAL)
    assert removal not in successors(scene, scene.goal, [removal], [hand])
    assert not list(successors(scene, scene.goal, [Action(hand, "cube", Target.GOAL)], [hand]))


def test_the_text_of_an_action_is_in_the_vocabulary_of_rai(scene):
    text = str(Action(Hand("panda", scene), "cube", Target.GOAL))
    assert text == "touch panda cube; stable panda cube; pose_eq cube goal"


def test_actions_with_different_grasps_on_tools_are_problems_of_their_own(scene):
    contact = ContactPoint(ContactKind.GRASP, IDENTITY, np.zeros(3), np.zeros(3), 0.02, np.zeros(3))
    grasps = [ToolGrasp("pawn", RobotContact("panda", contact, 0, np.zeros((1, 7))), IDENTITY) for _ in range(2)]
    bare, one, other = (Hand("panda", scene, grasp) for grasp in (None, *grasps))
    actions = [
        BoundedAction(Action(hand, "cube", Target.PLACE), IDENTITY, IDENTITY, [contact])
        for hand in (one, one, other, bare, Hand("panda", scene), one)
    ]
    assert [len(run) for run in runs_of(actions)] == [2, 1, 2, 1]
    assert Action(one, "cube", Target.GOAL) != Action(other, "cube", Target.GOAL)


def test_the_bound_by_poses_does_not_hold_while_the_goal_is_occupied(scene):
    state, rng = scene.start_state(), np.random.default_rng(0)
    action = Action(Hand("panda", scene), "cube", Target.GOAL)
    assert set(blockers(scene, state, "cube", scene.goal.pose)) == {"obstacle_1", "obstacle_2", "obstacle_3"}
    assert contacts_at_switches(state, action, scene.goal.pose, rng) == []
    for name, T in scene.removable.items():
        state.poses[name] = T
    assert contacts_at_switches(state, action, scene.goal.pose, rng)


def test_places_are_free_and_on_the_support(scene):
    state, rng = scene.start_state(), np.random.default_rng(0)
    T = target_pose(scene, state, scene.goal, Action(Hand("panda", scene), "cube", Target.PLACE), rng)
    assert T is not None and T[2] == pytest.approx(state.poses["cube"][2])
    assert blockers(scene, state, "cube", T) == []
    assert support_of(scene, state, "cube") == "table"


def test_a_published_task_is_solved_and_the_same_seed_gives_the_same_plan():
    first, second = (
        planner.plan(load_scene("published/puck_around", SEED), seed=SEED, planner="lgp", time_limit=60.0)
        for _ in range(2)
    )
    assert check(to_dict(first)).valid
    assert np.array_equal(first.trajectory.joints["panda"], second.trajectory.joints["panda"])


@pytest.mark.parametrize(
    ("options", "code"), [({"time_limit": 1e-3}, Code.TIME_LIMIT), ({"cancel": lambda: True}, Code.CANCELED)]
)
def test_it_ends_with_a_reason(options, code):
    with pytest.raises(PlannerError) as failure:
        planner.plan(load_scene("published/puck_around", 0), planner="lgp", **options)
    assert failure.value.code is code


def test_a_task_without_contacts_ends_before_the_time_is_up(monkeypatch):
    monkeypatch.setattr("hmap_core.baselines.lgp.bounds.contacts_of_move", lambda *arguments: [])
    with pytest.raises(PlannerError, match="bound by poses") as failure:
        planner.plan(load_scene("published/puck_around", 0), planner="lgp", time_limit=600.0)
    assert failure.value.code is Code.NO_CONTACT
