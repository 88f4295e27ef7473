"""KOMO and LGP*: the methods to which a skeleton is given."""

import json

import numpy as np
import pytest

from hmap_core.baselines.given_moves import BUILT_IN, given_moves
from hmap_core.baselines.komo.planner import Komo
from hmap_core.baselines.lgp_star.planner import LgpStar
from hmap_core.baselines.transfers import Transfer, TransferProblem
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plugins
from hmap_core.scenes import load_scene
from hmap_core.scenes.document import read
from hmap_core.transforms import pose
from hmap_core.types import ContactKind, ContactPoint
from hmap_core.validation import check

TASK = "published/puck_around"


@pytest.mark.parametrize("task", list(read(BUILT_IN).data))
def test_the_given_moves_bring_the_object_to_the_goal(task):
    scene = load_scene(task, seed=0)
    moves = given_moves(scene)
    last = moves[-1]
    assert last.object == scene.goal.object and np.allclose(last.T_end, scene.goal.pose)
    assert {move.object for move in moves} - {scene.goal.object} <= set(scene.removable)


@pytest.mark.parametrize("name", ["komo", "lgp_star"])
def test_a_baseline_solves_a_task_and_the_same_seed_gives_the_same_plan(name):
    scene = load_scene(TASK, seed=1)
    first, second = (plugins.create(plugins.PLANNERS, name).plan(scene, seed=1, time_limit=60.0) for _ in range(2))
    assert check(json.loads(json.dumps(to_dict(first)))).valid
    assert first.stats["claims"] >= 1 and first.stats["planning_time_s"] > 0.0
    for robot, q in first.trajectory.joints.items():
        assert np.array_equal(q, second.trajectory.joints[robot])


def test_lgp_star_goes_through_the_given_poses_and_komo_does_not_know_them():
    scene = load_scene(TASK, seed=0)
    (move,) = given_moves(scene)
    puck = LgpStar().plan(scene, seed=0).trajectory.objects["puck"]
    for T in move.through:
        assert np.linalg.norm(puck[:, :3] - T[:3], axis=1).min() < 0.01
    puck = Komo().plan(scene, seed=0).trajectory.objects["puck"]
    assert max(np.linalg.norm(puck[:, :3] - T[:3], axis=1).min() for T in move.through) > 0.01


def test_a_skeleton_of_ones_own(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(f"{TASK}:\n  - {{robot: panda, object: puck, slides_on: table, to: goal}}\n")
    plan = plugins.create(plugins.PLANNERS, f"komo:{file}").plan(load_scene(TASK, seed=0), seed=0)
    assert check(to_dict(plan)).valid


@pytest.mark.parametrize(
    "moves, said",
    [
        ("{robot: panda, object: puck, to: nowhere}", "must be one of goal, removal"),
        ("{robot: ur5, object: puck, to: goal}", "no such robot; there are panda"),
        ("{robot: panda, object: tray, to: goal}", "no body that can be moved; there are puck, pawn"),
        ("{robot: panda, object: pawn, to: goal}", "only 'puck' has a goal"),
        ("{robot: panda, object: puck, to: removal}", "no removal pose"),
        ("{robot: panda, object: puck, slides_on: floor, to: goal}", "floor"),
        ("{robot: panda, object: puck, to: goal, through: [{xyz: [1, 2]}]}", "xyz"),
        ("{robot: panda, object: puck}", "to: is missing"),
        ("panda", "panda"),
    ],
)
def test_a_wrong_skeleton_is_refused_with_file_and_line(tmp_path, moves, said):
    file = tmp_path / "mine.yaml"
    file.write_text(f"{TASK}:\n  - {moves}\n")
    with pytest.raises(InputError, match=said) as error:
        Komo(str(file)).plan(load_scene(TASK, seed=0))
    assert "mine.yaml:2" in str(error.value)


@pytest.mark.parametrize("text", ["{}", f"{TASK}: []", f"{TASK}: 3", "[1, 2]"])
def test_a_file_without_moves_is_refused(tmp_path, text):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"mine\.yaml"):
        LgpStar(str(file)).plan(load_scene(TASK, seed=0))


def test_a_task_without_a_skeleton_is_refused():
    with pytest.raises(InputError, match="no skeleton is given for task 'tunnel'; there are published/") as error:
        Komo().plan(load_scene("tunnel", seed=0))
    assert error.value.code is Code.UNKNOWN_TASK


@pytest.mark.parametrize("method", [Komo, LgpStar])
def test_time_limit_and_cancel_end_a_baseline(method):
    scene = load_scene(TASK, seed=0)
    with pytest.raises(PlannerError) as error:
        method().plan(scene, time_limit=0.0)
    assert error.value.code is Code.TIME_LIMIT
    with pytest.raises(PlannerError) as error:
        method().plan(scene, cancel=lambda: True)
    assert error.value.code is Code.CANCELED


def test_a_robot_stands_still_while_another_one_moves():
    scene = load_scene("published/tunnel", seed=0)
    state, goal = scene.start_state(), scene.goal.pose
    start = state.poses["bar"]
    contact = pose((0.28, 0.0, 0.05), (1.0, 0.0, 0.0, 0.0))
    down = np.array([0.0, 0.0, 1.0])
    touch = ContactPoint(ContactKind.TOUCH, contact, np.array([0.28, 0.0, 0.04]), down, 0.0, approach=down)
    nothing = np.zeros((0, 7))
    transfers = [
        Transfer("panda_1", "bar", touch, start, goal, nothing),
        Transfer("panda_2", "bar", touch, goal, start, nothing),
    ]
    problem = TransferProblem(scene, state, transfers).problem
    of_second, of_first = (o for o in problem.objectives if o.order == 1)
    assert (of_second.feature.params[0], of_first.feature.params[0]) == (7, 0)  # first joint of the idle robot
    assert [*of_second.steps, *of_first.steps] == list(range(problem.steps))
