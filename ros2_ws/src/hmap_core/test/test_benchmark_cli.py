"""``hmap bench komo``: its table, its JSON, and what it says without RAI."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from hmap_core.benchmark import measure, rai_side, registry, report
from hmap_core.benchmark.instances import Answer
from hmap_core.benchmark.problems.common import panda
from hmap_core.benchmark.problems.push_step import push_step
from hmap_core.benchmark.registry import Problem, Side
from hmap_core.benchmark.sampling import end_effector
from hmap_core.cli import main
from hmap_core.exceptions import InputError


def always(claimed: bool) -> Side:
    return Side(lambda seed: seed, lambda seed, prepared: Answer(claimed, np.array([[float(prepared)]])))


@pytest.fixture
def stub(monkeypatch):
    """A problem whose odd instances the judge rejects; RAI claims nothing."""
    judge = lambda seed, path: ["odd"] if seed % 2 else []  # noqa: E731
    problem = Problem(lambda seed: seed, always(True), always(False), judge)
    monkeypatch.setitem(registry.PROBLEMS, "stub", problem)
    return problem


def test_result(stub):
    result = measure.run(stub, 5)
    assert (result.hmap.verified, len(result.hmap.false_accepts)) == (3, 2)
    assert (result.rai.verified, len(result.rai.false_accepts)) == (0, 0)
    assert len(result.hmap.milliseconds) == 5
    assert result.ratio == result.rai.median / result.hmap.median


def test_command(stub, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(rai_side, "robotic", lambda: None)
    file, picture = tmp_path / "out.json", tmp_path / "out.png"
    arguments = ["--problems", "stub", "--instances", "4", "--json", str(file), "--plot", str(picture), "--verbose"]
    assert main(["bench", "komo", *arguments]) == 0
    printed = capsys.readouterr().out
    assert "stub" in printed and "hmap, seed 1: odd" in printed
    side = {"median_ms", "p90_ms", "verified", "false_accepts"}
    found = json.loads(file.read_text())
    assert set(found) == {"problems"} and set(found["problems"]) == {"stub"}
    stub_results = found["problems"]["stub"]
    assert set(stub_results) == {"n", "hmap", "rai", "ratio"} and stub_results["n"] == 4
    assert set(stub_results["hmap"]) == side and set(stub_results["rai"]) == side
    assert stub_results["hmap"]["verified"] == 2
    assert picture.stat().st_size > 1000


@pytest.mark.parametrize(
    "arguments, text",
    [
        (["--problems", "sudoku"], "problem 'sudoku' is not known; allowed: contact_ik"),
        (["--json", "/no/such/folder/x.json"], "there is no folder"),
    ],
)
def test_bad_input(arguments, text, capsys):
    assert main(["bench", "komo", *arguments]) == 2
    assert text in capsys.readouterr().err


def test_without_rai(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "robotic", None)
    assert main(["bench", "komo", "--problems", "push_step"]) == 2
    assert "pip install" in capsys.readouterr().err


def test_ompl_is_compared_where_a_problem_has_it(stub, tmp_path):
    result = measure.run(replace(stub, ompl=always(True)), 4)
    assert (result.ompl.verified, len(result.ompl.false_accepts)) == (2, 2)
    found = report.to_dict({"stub": result})["problems"]["stub"]
    assert found["ompl_ratio"] == result.ompl.median / result.hmap.median and found["ompl"]["verified"] == 2
    lines = [*report.heading(), *report.row("stub", result).split("\n")]
    assert len({len(line) for line in lines[1:]}) == 1 and "OMPL" in lines[-1]
    report.plot({"stub": result, "without": measure.run(stub, 2)}, tmp_path / "out.png")
    assert (tmp_path / "out.png").stat().st_size > 1000


def test_table_lines_up(stub):
    lines = [*report.heading(), report.row("stub", measure.run(stub, 2))]
    assert len(lines[1]) == len(lines[2])


def test_rai_has_our_panda():
    pytest.importorskip("robotic")
    instance = push_step(0)
    config = rai_side.prepare(instance).config
    robot = instance.scene.robots["panda"]
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(*robot.model.position_limits)
        config.setJointState(q)
        found, T = config.getFrame("panda_ee").getPose(), end_effector(robot, q)
        assert np.allclose(found[:3], T[:3], atol=1e-9)
        assert abs(found[3:] @ np.array(rai_side.wxyz(T))[3:]) == pytest.approx(1.0, abs=1e-12)
    assert np.allclose(config.getJointLimits(), robot.model.position_limits)


def test_rai_is_compared_on_the_panda_only():
    pytest.importorskip("robotic")
    instance = push_step(0)
    robot = panda()
    iiwa = replace(robot, model=replace(robot.model, name="iiwa"))
    scene = replace(instance.scene, robots={"panda": iiwa})
    with pytest.raises(InputError, match="no counterpart in RAI"):
        rai_side.prepare(replace(instance, scene=scene))
