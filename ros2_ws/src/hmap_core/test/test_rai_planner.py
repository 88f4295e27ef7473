"""RAI's KOMO as a method on the tasks of hmap."""

import sys
from types import ModuleType

import numpy as np
import pytest

from hmap_core.baselines.given_moves import given_moves
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.benchmark.rai_planner import STEPS, RaiKomo, RaiLgpStar, motion_instance
from hmap_core.cli.bench_table import planner_names
from hmap_core.exceptions import Code, InputError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plugins
from hmap_core.scenes import load_scene
from hmap_core.validation import check

TASK = "published/puck_around"


def test_without_rai_its_methods_are_refused_and_left_out_of_a_table(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "robotic", None)
    with pytest.raises(InputError, match="RAI is needed"):
        plugins.create(plugins.PLANNERS, "rai_komo")
    names = planner_names([])
    assert "komo" in names and not {"rai_komo", "rai_lgp_star"} & set(names)
    assert "without rai_komo: " in capsys.readouterr().err


def test_a_task_of_several_moves_cannot_be_stated(monkeypatch):
    monkeypatch.setitem(sys.modules, "robotic", ModuleType("robotic"))
    with pytest.raises(InputError, match="4 moves; allowed: 1") as error:
        RaiKomo().plan(load_scene("published/puck_move", seed=0))
    assert error.value.code is Code.UNKNOWN_TASK


def test_the_instance_has_the_targets_of_the_move():
    scene = load_scene(TASK, seed=0)
    state = scene.start_state()
    (move,) = given_moves(scene)
    poses = np.array([state.poses["puck"], *move.through, move.T_end])
    contact = contacts_of_move(scene, state, "panda", "puck", poses, np.random.default_rng(0))[0]
    instance = motion_instance(scene, state, move, contact, poses, 0)
    assert instance.steps_per_phase == (STEPS,) * len(poses)
    touching = [target for target in instance.targets if target.before == 0]
    assert [target.phase for target in touching] == [0, 1, 2, 3]
    moved = np.array([target.T_world_ee[:3] for target in touching]) - touching[0].T_world_ee[:3]
    assert moved == pytest.approx(poses[:, :3] - poses[0, :3])
    assert instance.attachments[0].support == "table"


@pytest.mark.slow
@pytest.mark.parametrize("method", [RaiKomo, RaiLgpStar])
def test_rai_solves_a_task(method):
    pytest.importorskip("robotic")
    plan = method().plan(load_scene(TASK, seed=0), seed=0, time_limit=120.0)
    assert check(to_dict(plan)).valid
