"""``hmap bench limits``: its cases, and its table; how long motions take is not looked at."""

import itertools
import json

import numpy as np
import pytest
from simulation_fixtures import scene

from hmap_core.benchmark import limits
from hmap_core.cli import main


def test_the_motions_of_a_case_differ_by_a_shift_onto_limits():
    world = scene()
    lower, upper = world.robots["left"].model.position_limits
    for inside, on_limits in itertools.islice(limits.cases(world, "left", 0), 10):
        np.testing.assert_allclose(on_limits.goal - on_limits.start, inside.goal - inside.start, atol=1e-12)
        assert ((on_limits.goal == lower) | (on_limits.goal == upper)).any()
        assert not ((inside.goal == lower) | (inside.goal == upper)).any()
        for q in (inside.start, inside.goal, on_limits.start, on_limits.goal):
            assert (lower <= q).all() and (q <= upper).all()


def test_cases_repeat_by_seed():
    first, second = (list(itertools.islice(limits.cases(scene(), "left", 1), 3)) for _ in range(2))
    np.testing.assert_array_equal([[m.goal for m in pair] for pair in first], [[m.goal for m in p] for p in second])


def test_the_command_prints_both_and_their_ratio(monkeypatch, capsys, tmp_path):
    costs = limits.Costs([0.01, 0.03, 0.02]), limits.Costs([0.02, 0.02, 0.06], failures=1)
    monkeypatch.setattr(limits, "measure", lambda *arguments: costs)
    assert main(["bench", "limits", "--json", str(tmp_path / "out.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "3 motions of 'panda' each, CPU time"
    assert "20.0 ms" in lines[1] and "1 not found" in lines[2]
    assert lines[3].split() == ["ratio", "median", "1.00", ",", "mean", "1.67"]
    assert json.loads((tmp_path / "out.json").read_text())["inside"]["seconds"] == pytest.approx([0.01, 0.03, 0.02])
