"""The examples run, each in a fresh process and a folder of its own, and print what they promise."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
LIMIT = 900.0  # s on a busy machine with nothing compiled
FIRST_DOMAIN, DOMAINS = 120, 100  # ROS_DOMAIN_ID; each process of tests takes its own
# example -> texts in what it prints
PRINTS = {
    "01_plan_a_task": ("contacts on 'bolt'", "grasp, bolt", "the judge says: valid"),
    "02_own_scene_in_code": ("Did you mean 'panda'?", "segments"),
    "03_own_feature": ("feasible: True",),
    "04_own_robot": ("my_iiwa: 7 joints, no gripper", "segments"),
    "05_own_proposer": ("contact: [0.",),
    "06_own_object_path_planner": ("the brick rises to 0.23 m",),
    "07_own_method": ("the best plan takes",),
    "08_drive_the_graph": ("planned:", "executed", "the brick is at [0.45", "[planner/CANCELED]"),
}
WRITES = {"01_plan_a_task": "bolt.json", "02_own_scene_in_code": "shelf.yaml"}


def test_every_example_is_tested() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == set(PRINTS)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRINTS)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    environment = dict(os.environ, ROS_DOMAIN_ID=str(FIRST_DOMAIN + os.getpid() % DOMAINS))
    done = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py")],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode == 0, done.stderr
    assert [text for text in PRINTS[name] if text not in done.stdout] == [], done.stdout
    if name in WRITES:
        assert (tmp_path / WRITES[name]).stat().st_size > 0
