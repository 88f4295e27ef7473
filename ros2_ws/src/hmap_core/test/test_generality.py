"""``hmap bench generality``: every family's tasks load, can be begun and differ; the report, and a real family."""

import json
import re

import numpy as np
import pytest

from hmap_core.benchmark.generality import registry, report
from hmap_core.benchmark.generality.family import Family, Refusal, refused
from hmap_core.benchmark.generality.registry import FAMILIES
from hmap_core.cli import main
from hmap_core.evaluation import trials as runner
from hmap_core.evaluation.trial import NOT_VALID, TrialResult
from hmap_core.exceptions import Code, InputError
from hmap_core.planner.preconditions import check_bodies, check_goal, check_robots
from hmap_core.scenes import load_scene
from hmap_core.scenes.document import read_key
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import BodyKind

SEEDS = range(4)
ALL = list(FAMILIES.values())
SOLVABLE = [family for family in ALL if family.refusal is None]
SETTLED = 0.003, 2.0  # m and degrees that a body may move while it comes to rest


def name_of(family: Family) -> str:
    return family.name


def turned(a: np.ndarray, b: np.ndarray) -> float:
    """The angle in degrees between two poses (7,)."""
    return float(np.rad2deg(2 * np.arccos(min(1.0, abs(a[3:] @ b[3:])))))


def test_there_are_enough_families():
    assert len(SOLVABLE) >= 30 and len(ALL) - len(SOLVABLE) >= 6
    assert all(family.description.endswith(".") for family in ALL)


@pytest.mark.parametrize("family", ALL, ids=name_of)
def test_tasks_load_and_can_be_begun(family, tmp_path):
    """Also those without a solution, but for a goal inside of something: their bodies stand free and have support."""
    for seed in SEEDS:
        path = tmp_path / f"{seed}.yaml"
        path.write_text(family.task_file(seed), encoding="utf-8")
        assert bool(read_key(path, "unsolvable")) == (family.refusal is not None)
        scene = load_scene(path)
        check_goal(scene, scene.goal)
        check_robots(scene, scene.start_state(), scene.goal.object)
        check_bodies(scene, scene.goal)


def test_rakes_begin_beside_the_legs_of_the_shelf():
    for seed in range(4, 16):
        scene = FAMILIES["rake_under_shelf"].cell(seed).build()
        check_bodies(scene, scene.goal)


@pytest.mark.parametrize("family", ALL, ids=name_of)
def test_a_seed_gives_the_same_task_and_another_seed_another_one(family):
    texts = [family.task_file(seed) for seed in SEEDS]
    assert texts == [family.task_file(seed) for seed in SEEDS]
    without_seed = {re.sub(r"seed\s+\d+", "", text) for text in texts}
    assert len(without_seed) == len(texts)


@pytest.mark.parametrize("family", SOLVABLE, ids=name_of)
@pytest.mark.parametrize("at_goal", [False, True])
def test_bodies_stay_where_they_start_and_the_object_at_its_goal(family, at_goal):
    """In the simulation, for half a second; at its goal without what may be removed."""
    scene = family.cell(0).build()
    gone = set(scene.removable) if at_goal else set()
    with SimulatedWorld(scene) as world:
        for k, name in enumerate(sorted(gone)):
            world.move_body(name, [-5.0, k, 0.5, 0, 0, 0, 1])
        if at_goal:
            world.move_body(scene.goal.object, scene.goal.pose)
        still = [name for name, body in scene.bodies.items() if body.kind != BodyKind.FIXED and name not in gone]
        before = {name: world.body_pose(name) for name in still}
        for _ in range(120):
            world.step()
        for name in still:
            after = world.body_pose(name)
            assert after[:3] == pytest.approx(before[name][:3], abs=SETTLED[0]), name
            if scene.goal.rotation_tolerance < 3.0 or name != scene.goal.object:
                assert turned(before[name], after) < SETTLED[1], name


def test_unknown_family_is_bad_input():
    with pytest.raises(InputError, match="unknown family 'stak'. Known: .*build_stack"):
        registry.families(["stak"])
    assert registry.families(["over_wall", "over_wall"]) == [FAMILIES["over_wall"]]


def build_nothing(cell, draw):
    """Nothing can be done."""


def test_a_refusal_is_right_with_the_expected_code_and_reason_only():
    family = refused(build_nothing, Code.NO_CONTACT, reason="cube.*mm")
    right = TrialResult(0, reason="[contacts/NO_CONTACT] 'Cube' is 92 mm wide", code="NO_CONTACT", cpu_s=0.5)
    seen = family.judged(right)
    assert seen.solved and seen.valid and not seen.reason and not seen.code and seen.cpu_s == 0.5
    for code, reason in (("TIME_LIMIT", "'cube' is 92 mm wide"), ("NO_CONTACT", "none of 480 contacts")):
        seen = family.judged(TrialResult(0, reason=reason, code=code))
        assert not seen.solved and seen.valid and seen.code == code and reason in seen.reason
    for planned in (TrialResult(0, valid=True, solved=True), TrialResult(0, code=NOT_VALID)):
        seen = family.judged(planned)
        assert not seen.solved and not seen.valid and seen.code == "PLANNED"
    assert not family.judged(TrialResult(0, reason="the process ended")).valid


def test_a_solvable_family_leaves_results_alone():
    result = TrialResult(0, valid=True, solved=True)
    assert FAMILIES["over_wall"].judged(result) is result


@pytest.mark.parametrize(
    "solved, n, low, high", [(10, 10, 0.7225, 1.0), (0, 4, 0.0, 0.4899), (81, 100, 0.7222, 0.8749)]
)
def test_wilson_interval(solved, n, low, high):
    assert report.wilson(solved, n) == (pytest.approx(low, abs=1e-4), pytest.approx(high, abs=1e-4))


def results() -> dict[str, list[TrialResult]]:
    good = TrialResult(0, valid=True, solved=True, planning_s=1.5, cpu_s=1.6, waypoints=2)
    bad = [TrialResult(k, code="NO_CONTACT", reason=f"none of {k}0 contacts") for k in (1, 2)]
    return {"a": [good, *bad], "b": [TrialResult(0, reason="the process ended")]}


def test_failures_are_counted_by_code_and_kind_of_reason():
    assert report.failures(results()) == [
        "a: NO_CONTACT, seeds 1, 2: none of 10 contacts",
        "b: ENDED, seeds 0: the process ended",
    ]
    found = report.to_dict(results())
    assert found["families"]["a"]["failures"][0]["n"] == 2 and found["families"]["a"]["solved"] == 1
    assert (found["all"]["n"], found["all"]["solved"]) == (4, 1) and "trials" not in found["all"]
    json.dumps(found)


def test_table_has_the_interval_and_a_row_for_all():
    lines = report.table(results())
    assert len({len(line) for line in lines}) == 1
    assert lines[1].split() == ["a", "3", "1", "1", "6-79", "1.50", "1.50", "1.60", "2", "-", "-", "0"]
    assert [line.split()[0] for line in lines] == ["family", "a", "b", "all"]
    assert len(report.table({"a": results()["a"]})) == 2
    assert report.markdown(results())[0].startswith("| family | n | valid | solved | 95 % |")


def test_command(monkeypatch, tmp_path, capsys):
    asked = []

    def run_trials(wanted, jobs, on_result):
        asked.extend(wanted)
        found = [TrialResult(t.seed, code="GOAL_IN_COLLISION", reason="'block' is 9 mm in 'wall'") for t in wanted]
        for trial, result in zip(wanted, found, strict=True):
            on_result(trial, result)
        return found

    monkeypatch.setattr(runner, "run_trials", run_trials)
    out, saved, file = tmp_path / "out", tmp_path / "tasks", tmp_path / "results.json"
    options = ["--seeds", "2", "--first-seed", "5", "--save", str(saved), "--out", str(out), "--json", str(file)]
    assert main(["bench", "generality", "--families", "goal_in_wall", *options]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines()[1].split()[:4] == ["goal_in_wall", "2", "2", "2"] and "seed 6: solved" in told.err
    assert [trial.seed for trial in asked] == [5, 6] and all(trial.time_limit is None for trial in asked)
    assert (saved / "goal_in_wall-6.yaml").read_text() == FAMILIES["goal_in_wall"].task_file(6)
    assert json.loads(file.read_text()) == json.loads((out / "generality.json").read_text())
    assert (out / "generality.md").read_text().startswith("| family |")
    assert main(["bench", "generality", "--families", "over_wall", "--seeds", "1"]) == 1
    assert "over_wall: GOAL_IN_COLLISION, seeds 0" in capsys.readouterr().out


def test_families_are_listed(capsys):
    assert main(["bench", "generality", "--list"]) == 0
    told = capsys.readouterr().out
    assert all(f"{family.name} " in told and family.description in told for family in ALL)


@pytest.mark.slow
def test_a_real_family(tmp_path):
    file = tmp_path / "results.json"
    arguments = ["--families", "over_wall", "goal_in_wall", "--seeds", "1", "--jobs", "1", "--json", str(file)]
    assert main(["bench", "generality", *arguments]) == 0
    assert json.loads(file.read_text())["all"]["solved"] == 2


def test_refusal_reads_codes_and_reasons():
    refusal = Refusal(frozenset({Code.OUT_OF_REACH}), r"\d m")
    assert refusal("OUT_OF_REACH", "it is 3 M away") and not refusal("OUT_OF_REACH", "far")
    assert not refusal("NO_CONTACT", "3 m") and not refusal("", "3 m")
