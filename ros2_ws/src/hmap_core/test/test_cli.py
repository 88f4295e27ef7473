"""The command: exit codes 0, 1 and 2, results on standard output, one line for an error."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim
import validation_fixtures as plans

from hmap_core import plan_file, transforms
from hmap_core.cli import main
from hmap_core.cli.progress import ProgressLine
from hmap_core.types import Goal, TaskMode


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


def write(path, document) -> str:
    path.write_text(json.dumps(document))
    return str(path)


def dragged(tmp_path, by=(0.05, 0.0, 0.0), goal=(0.55, 0.0, 0.03), mode=TaskMode.PHYSICAL) -> str:
    """A plan file: a Panda drags a box by a vector."""
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03))
    scene = sim.scene(box, mode=mode, goal=Goal("box", transforms.pose(goal)))
    plan = plan_fixtures.drag_plan(scene, "box", 0.06, np.array(by))
    contact = transforms.pose((0.0, 0.0, 0.0), plan_fixtures.DOWN)
    segments = tuple(replace(s, contact_pose=contact if s.object else None) for s in plan.segments)
    plan_file.save(replace(plan, segments=segments), tmp_path / "plan.json")
    return str(tmp_path / "plan.json")


def test_tasks_are_listed_with_a_description(capsys):
    assert main(["tasks"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("tunnel ") and len(line) > 30 for line in lines)


def test_valid_plan_is_reported_as_json(urdf, tmp_path, capsys):
    assert main(["check", write(tmp_path / "p.json", plans.carry(urdf)), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["valid"] is True and out["violations"] == []
    assert set(out) == {"valid", "violations", "goal_error", "min_clearance_m", "min_held_clearance_m"}


def test_invalid_plan_is_reported_as_json(urdf, tmp_path, capsys):
    plan = plans.carry(urdf)
    plan["goal"]["pose"][0] += 0.1
    assert main(["check", write(tmp_path / "p.json", plan), "--json"]) == 1
    out = json.loads(capsys.readouterr().out)
    assert out["valid"] is False
    assert [set(v) for v in out["violations"]] == [{"kind", "bodies", "time", "amount", "limit"}]


def test_check_for_people_names_the_violation(urdf, tmp_path, capsys):
    plan = plans.carry(urdf)
    plan["goal"]["pose"][0] += 0.1
    assert main(["check", write(tmp_path / "p.json", plan)]) == 1
    assert "goal_missed" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["check", "execute"])
@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "hmap-plan"}', "NaN"])
def test_a_file_that_is_no_plan_is_bad_input(command, text, tmp_path, capsys):
    (tmp_path / "p.json").write_text(text)
    assert main([command, str(tmp_path / "p.json")]) == 2
    assert_one_error(capsys, "input/INVALID_PLAN_FILE")


@pytest.mark.parametrize("command", ["check", "execute"])
def test_a_missing_file_is_bad_input(command, tmp_path, capsys):
    assert main([command, str(tmp_path / "missing.json")]) == 2
    assert_one_error(capsys, "missing.json")


def test_executed_plan_that_solves_its_task(tmp_path, capsys):
    assert main(["execute", dragged(tmp_path), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["solved"] is True and out["reason"] == ""
    assert out["goal_error"]["position_m"] < 0.02
    assert set(out["goal_error"]) == {"position_m", "rotation_deg"}


def test_executed_plan_that_misses_its_goal(tmp_path, capsys):
    assert main(["execute", dragged(tmp_path, goal=(0.6, 0.0, 0.03)), "--json"]) == 1
    out = json.loads(capsys.readouterr().out)
    assert out["solved"] is False and "box" in out["reason"]


def test_kinematic_plan_cannot_be_executed(tmp_path, capsys):
    assert main(["execute", dragged(tmp_path, mode=TaskMode.KINEMATIC), "--json"]) == 2
    assert_one_error(capsys, "kinematic")


def test_unknown_task_is_bad_input(capsys):
    assert main(["plan", "tunel"]) == 2
    assert_one_error(capsys, "input/UNKNOWN_TASK", "tunel", "tunnel")


def test_task_file_with_an_error_names_it(tmp_path, capsys):
    (tmp_path / "my.yaml").write_text("schema: 1\nmoed: physical\n")
    assert main(["plan", str(tmp_path / "my.yaml")]) == 2
    assert_one_error(capsys, "my.yaml", "moed")


def test_output_that_cannot_be_written_is_refused_before_planning(tmp_path, capsys):
    assert main(["plan", "tunnel", "--out", str(tmp_path / "no" / "plan.json")]) == 2
    assert_one_error(capsys, "no folder")


def test_no_time_to_plan_says_so(tmp_path, capsys):
    assert main(["plan", "tunnel", "--time-limit", "0.000001", "--out", str(tmp_path / "p.json")]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("hmap: [")
    assert not (tmp_path / "p.json").exists()


@pytest.mark.parametrize("arguments", ["", "nonsense", "plan tunnel --seed -1", "plan tunnel --seed x", "check"])
def test_wrong_arguments_are_bad_input(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments.split())
    assert end.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_debug_shows_the_trace(capsys):
    assert main(["plan", "tunel", "--debug"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_only_results_are_on_standard_output(tmp_path):
    command = [sys.executable, "-m", "hmap_core", "execute", dragged(tmp_path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0
    assert json.loads(done.stdout)["solved"] is True


class Stream:
    def __init__(self, terminal: bool):
        self.text, self.terminal = "", terminal

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


def test_progress_is_a_line_per_change_without_a_terminal():
    stream = Stream(False)
    with ProgressLine(stream) as line:
        line.planning("contacts", 2, 5, 1, "contacts on 'bar'")
        line.planning("contacts", 2, 5, 1, "contacts on 'bar'")
        line.planning("motion", 2, 5, 3)
    lines = stream.text.splitlines()
    assert len(lines) == 2
    assert lines[0].endswith("contacts: waypoint 2 of 5, try 1, contacts on 'bar'")
    assert lines[1].endswith("motion: waypoint 2 of 5, try 3")


def test_progress_rewrites_one_line_on_a_terminal():
    stream = Stream(True)
    with ProgressLine(stream) as line:
        line.show("waypoints")
        line.show("contacts")
    assert "\n" not in stream.text
    assert stream.text.endswith("\r\033[K")


def assert_one_error(capsys, *parts: str) -> None:
    err = capsys.readouterr().err
    last = err.splitlines()[-1]
    assert last.startswith("hmap: ") and "Traceback" not in err
    for part in parts:
        assert part in last
