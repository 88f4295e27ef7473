"""The ablation of learned contacts: its ratios, and the command."""

import json

import pytest

from hmap_core.cli import main
from hmap_core.learning.ablation import Comparison, Run, table


def runs(*seconds):
    return tuple(Run(True, s, s / 2) for s in seconds)


def test_the_ratio_is_that_of_the_sums_with_an_interval_round_it():
    one = Comparison("task", runs(2.0, 1.0, 3.0), runs(1.0, 1.0, 1.0))
    ratio, low, high = one.ratio("cpu_s")
    assert ratio == pytest.approx(0.5) and low <= ratio <= high and low >= 1 / 3
    assert one.ratio("cpu_s") == (ratio, low, high)  # the same seed draws the same
    assert "| task | 3 | 3 / 3 |" in table([one])[-1]


def test_the_command_writes_runs_and_figure(tmp_path, capfd):
    out, picture = tmp_path / "runs.json", tmp_path / "ratios.png"
    assert (
        main(["bench", "learning", "--tasks", "bolt", "--seeds", "1", "--json", str(out), "--figure", str(picture)])
        == 0
    )
    found = json.loads(out.read_text())[0]
    assert found["task"] == "bolt" and len(found["sampled"]) == len(found["learned"]) == 1
    assert picture.stat().st_size > 1000
    assert main(["bench", "learning", "--tasks", "bolt", "--json", str(tmp_path)]) != 0


def test_weights_that_are_missing_are_named(tmp_path, capfd):
    assert main(["bench", "learning", "--tasks", "bolt", "--weights", str(tmp_path / "none.safetensors")]) != 0
    assert "cannot be read" in capfd.readouterr().err
