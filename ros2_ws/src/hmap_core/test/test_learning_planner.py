"""What a ranker changes in the planner: the order in which hands, tools and holds are tried, and nothing else."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.learning.proposer import _likeliest, where_known
from hmap_core.planner import HmapPlanner
from hmap_core.planner.components import local_components
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.manipulator_order import contact_strategies
from hmap_core.planner.robot_order import robot_order
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.steps import Manipulator
from hmap_core.planner.strategies import ATTACHED_FIRST, CONTACT_STRATEGIES, TOOL_FIRST
from hmap_core.planner.tool_grasps import LOOKED_AT, ToolGraspSearch
from hmap_core.scenes import load_scene


class Ranker:
    """Expects what it is told."""

    name = "told"

    def __init__(self, hand=1.0, hold=1.0):
        self.hand, self.hold, self.asked = hand, hold, 0

    def propose(self, query):
        return iter(())

    def hand_serves(self, scene, state, object, object_poses, robots):
        return np.full(len(robots), self.hand)

    def hold_serves(self, scene, state, object, object_poses, holds):
        self.asked += 1
        order = np.linspace(1.0, 0.5, len(holds))
        return self.hold * order, order


@pytest.fixture(scope="module")
def scene():
    return load_scene("puck_move", seed=7)


def task_of(scene, ranker, grasp=None):
    state = scene.start_state()
    context = SimpleNamespace(scene=scene, components=SimpleNamespace(ranker=ranker))
    sequence = SimpleNamespace(state=state, tool_grasp=grasp)
    ahead = np.tile(state.poses[scene.goal.object], (10, 1))
    return SimpleNamespace(context=context, sequence=sequence, object=scene.goal.object, ahead=ahead)


def test_tools_come_first_only_where_no_hand_is_expected_to_serve(scene):
    assert contact_strategies(task_of(scene, None)) is CONTACT_STRATEGIES
    assert contact_strategies(task_of(scene, Ranker(hand=0.9))) is CONTACT_STRATEGIES
    assert contact_strategies(task_of(scene, Ranker(hand=0.05))) is TOOL_FIRST
    assert contact_strategies(task_of(load_scene("bolt"), Ranker(hand=0.0))) is CONTACT_STRATEGIES


def test_an_attached_tool_comes_first_if_it_is_expected_to_serve_more_than_a_hand(scene):
    grasp = SimpleNamespace(tool="pawn", T_place=scene.bodies["pawn"].pose)
    assert contact_strategies(task_of(scene, Ranker(hand=0.5, hold=0.9), grasp)) is ATTACHED_FIRST
    assert contact_strategies(task_of(scene, Ranker(hand=0.5, hold=0.1), grasp)) is CONTACT_STRATEGIES


def test_every_order_tries_hands_and_tools():
    for order in (TOOL_FIRST, ATTACHED_FIRST):
        names = {strategy.name for strategy in order}
        assert {"by hand", "with a tool", "by hand, however far it reaches"} <= names


class HandRanker(Ranker):
    """Expects something else of each robot."""

    def hand_serves(self, scene, state, object, object_poses, robots):
        self.asked += 1
        return np.array([self.hand[robot] for robot in robots])


def test_a_robot_that_is_expected_to_serve_hardly_any_pose_is_queried_last():
    scene = load_scene("tunnel", seed=1)
    state, name = scene.start_state(), scene.goal.object
    ahead = np.tile(state.poses[name], (10, 1))
    near, far = robot_order(None, scene, state, name, ahead)

    def order(**hand):
        return robot_order(HandRanker(hand), scene, state, name, ahead)

    assert order(**{near: 0.5, far: 0.9}) == (near, far)  # both may serve: the distance counts
    assert order(**{near: 0.05, far: 0.9}) == (far, near)
    assert order(**{near: 0.05, far: 0.06}) == (near, far)


def test_one_robot_is_not_ranked(scene):
    ranker, state = HandRanker({}), scene.start_state()
    assert robot_order(ranker, scene, state, "cube", state.poses["cube"][None]) == ("panda",) and not ranker.asked


def test_the_robots_of_a_waypoint_are_in_the_order_of_the_ranker():
    scene = load_scene("tunnel", seed=1)
    state, name = scene.start_state(), scene.goal.object
    near, far = robot_order(None, scene, state, name, state.poses[name][None])
    task = task_of(scene, HandRanker({near: 0.0, far: 1.0}))
    assert Manipulator.of(task, None).robots == (far, near)


def test_a_proposer_that_ranks_is_used_for_tools_and_one_that_does_not_is_not():
    ranker = Ranker()
    assert local_components(proposer=ranker).ranker is ranker
    assert local_components(proposer=SampledContacts()).ranker is None
    assert local_components().ranker is None
    assert HmapPlanner().components.ranker is not None


def test_contacts_of_which_alike_is_expected_stay_in_the_order_of_the_sampler():
    assert _likeliest(np.array([0.1, 0.8, 0.5, 0.3, 0.9, 0.2])).tolist() == [1, 2, 4, 3, 5, 0]


def test_by_default_nothing_changes_where_the_model_knows_nothing(tmp_path, recwarn):
    ranker, tool = where_known(), "pawn"
    scene = load_scene("published/puck_around", 0)
    state, name = scene.start_state(), scene.goal.object
    path, robots = np.tile(state.poses[name], (9, 1)), tuple(scene.robots)
    holds = [ToolGrasp(tool, c, state.poses[tool]) for c in ToolGraspSearch(SampledContacts()).holds(
        scene, state, tool, robots[0], np.random.default_rng(0))]  # fmt: skip
    assert holds and not np.any(ranker.hold_serves(scene, state, name, path, holds))
    assert np.all(ranker.hand_serves(scene, state, name, path, robots) == 1.0)
    plans = [planner.plan(scene, seed=0, **options) for options in ({}, {"proposer": "sampled"})]
    first, second = (plan.trajectory.joints for plan in plans)
    assert all(np.array_equal(first[name], second[name]) for name in first) and not recwarn.list


def test_no_tool_is_looked_at_first_that_is_not_expected_to_serve(scene):
    state, name = scene.start_state(), "cube"
    ahead = np.tile(state.poses[name], (10, 1))
    poor = Ranker(hold=0.1)
    search = ToolGraspSearch(SampledContacts(), poor)
    search._bound = None  # no contact of a tool is generated
    assert search.tool_grasps(scene, state, name, ahead, 0, 60.0, likely=0.35) == [] and poor.asked == 1


@pytest.mark.parametrize("likely, all_looked_at", [(0.35, False), (0.0, True)])
def test_before_hands_only_the_tool_grasps_that_a_ranker_names_are_looked_at(scene, likely, all_looked_at):
    state, name = scene.start_state(), "cube"
    search, looked_at = ToolGraspSearch(SampledContacts(), Ranker(hold=0.4)), []

    def serves_nothing(*arguments):
        looked_at.append(arguments)
        return SimpleNamespace(reach=-1)

    search._bound = serves_nothing
    assert search.tool_grasps(scene, state, name, np.tile(state.poses[name], (10, 1)), 0, 60.0, likely=likely) == []
    assert len(looked_at) > LOOKED_AT if all_looked_at else len(looked_at) == LOOKED_AT


def test_the_order_of_a_ranker_that_expects_little_of_all_tool_grasps_does_not_count(scene):
    state, name = scene.start_state(), "cube"
    ahead = np.tile(state.poses[name], (12, 1))
    ahead[:, 0] += 0.004 * np.arange(12)
    chosen = [
        ToolGraspSearch(SampledContacts(), ranker).tool_grasps(scene, state, name, ahead, 0, 60.0)
        for ranker in (None, Ranker(hold=0.1))
    ]
    frames = [[(grasp.contact.contact.T_obj_ee.tolist(), bound) for grasp, bound in grasps] for grasps in chosen]
    assert frames[0] and frames[0] == frames[1]


@pytest.mark.parametrize("expected", [0.0, 1.0])
def test_a_ranker_that_is_wrong_costs_time_and_nothing_else(scene, expected):
    ranker = Ranker(hand=1.0 - expected, hold=expected)
    plan = planner.plan(scene, seed=1, proposer=ranker)  # the judge has accepted it
    assert ranker.asked and plan.stats["learned_contacts"] == 0 and plan.stats["contacts_checked"] > 0


def test_the_learned_proposer_plans_with_tools_and_repeats_itself():
    plans = [planner.plan(load_scene("tunnel_tool", seed=1), seed=1, proposer="learned") for _ in range(2)]
    assert plans[0].stats["learned_contacts"] > 0
    first, second = (plan.trajectory.joints for plan in plans)
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_without_tools_a_plan_is_the_one_of_sampled_contacts():
    plans = [planner.plan(load_scene("bolt", seed=2), seed=2, proposer=name) for name in ("learned", "sampled")]
    first, second = (plan.trajectory.joints for plan in plans)
    assert all(np.array_equal(first[name], second[name]) for name in first)
