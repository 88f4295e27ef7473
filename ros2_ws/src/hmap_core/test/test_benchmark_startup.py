"""The measurement of starts; what it measures depends on the machine, so only that it measures is looked at."""

import json

import pytest

from hmap_core.benchmark import startup
from hmap_core.cli import main
from hmap_core.exceptions import ExecutionError


def test_a_command_is_run_as_often_as_asked():
    starts = startup.run(("--help",), 2)
    assert len(starts) == 2
    assert all(0.0 < start.cpu and 0.0 < start.wall for start in starts)


def test_a_command_that_fails_is_an_error():
    with pytest.raises(ExecutionError, match="hmap plan no_task ended with 2: .*UNKNOWN_TASK"):
        startup.run(("plan", "no_task"), 1)


def test_the_table_has_medians(tmp_path, capsys, monkeypatch):
    starts = [startup.Start(cpu, 2.0 * cpu) for cpu in (1.0, 5.0, 1.5)]
    monkeypatch.setattr(startup, "run", lambda command, repeats: starts)
    assert main(["bench", "startup", "--no-graph", "--json", str(tmp_path / "out.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + len(startup.COMMANDS)
    assert lines[1].split() == ["hmap", "--help", "1.50", "s", "3.00", "s"]
    assert json.loads((tmp_path / "out.json").read_text())["tasks"][1] == {"cpu": 5.0, "wall": 10.0}
