"""Cell files are read strictly, and their parameters reach the nodes."""

from pathlib import Path

import pytest

from hmap.commands.cell import start
from hmap.launcher.cell import PLANNING, read_cell
from hmap.launcher.processes import NodeProcess, node_command
from hmap_core.exceptions import InputError


def read(tmp_path, text: str):
    (tmp_path / "cell.yaml").write_text(text)
    return read_cell(tmp_path / "cell.yaml")


def test_a_cell_file(tmp_path):
    (tmp_path / "own.yaml").write_text("/**: {ros__parameters: {}}")
    cell = read(
        tmp_path,
        "{task: mine.yaml, drivers: [franka_ros2, own.yaml], parameters: {supervisor: {replans: 0}}, record: false}",
    )
    assert cell.task == str(tmp_path / "mine.yaml") and cell.seed == 0 and not cell.record
    assert [file.name for file in cell.files] == ["franka_ros2.yaml", "own.yaml"]
    assert cell.of("supervisor", replans=3) == {"use_sim_time": False, "replans": 0}
    assert cell.of("perception") == {"use_sim_time": False, "task": cell.task, "seed": 0}
    command = node_command("supervisor", ["replans:=0"], cell.files)
    assert command.count("--params-file") == 2 and command.index("-p") > command.index("--params-file")
    assert read(tmp_path, "{task: tunnel, drivers: vrpn_mocap}").files[0].name == "vrpn_mocap.yaml"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[]", "is a table with the key task"),
        ("{seed: 1}", "is a table with the key task"),
        ("{task: tunnel, robots: 1}", "unknown key 'robots'; allowed: task, seed"),
        ("{task: 3}", "task = 3: the name of a task"),
        ("{task: tunnel, seed: -1}", "seed = -1"),
        ("{task: tunnel, seed: true}", "seed = True"),
        ("{task: tunnel, record: 1}", "record = 1: true or false"),
        ("{task: tunnel, drivers: [none]}", "'none' is no file, and none of franka_ros2"),
        ("{task: tunnel, drivers: 5}", "drivers = 5: a list"),
        ("{task: tunnel, parameters: {world: {}}}", "unknown node 'world'; allowed: perception"),
        ("{task: tunnel, parameters: {supervisor: 1}}", "parameters: a table of nodes"),
        ("{task: [", "is no YAML"),
    ],
)
def test_wrong_cell_files_are_refused_with_file_and_key(tmp_path, text, says):
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    assert says in error.value.reason and "cell.yaml" in error.value.reason


def test_a_cell_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="none.yaml: cannot be read"):
        read_cell(tmp_path / "none.yaml")


class Started(dict):
    """In place of a graph: process -> its command line."""

    def start(self, name, parameters=None, files=()):
        process = NodeProcess(name, parameters or {}, Path(name), files)
        self[name] = process.command()


def test_supervisor_and_planners_share_a_process_and_keep_their_own_parameters(tmp_path):
    cell = read(tmp_path, "{task: tunnel, drivers: vrpn_mocap, parameters: {komo_optimiser: {warm_up: false}}}")
    apart, together = Started(), Started()
    start(apart, cell, tmp_path, {"dry_run": True})
    start(together, cell, tmp_path, {"dry_run": True}, one_process=True)
    assert apart.keys() == {"recorder", "perception", *PLANNING}
    assert together.keys() == {"recorder", "perception", "composed_planning"}
    words = together["composed_planning"]
    assert {"supervisor:dry_run:=true", "supervisor:service_patience:=30.0", "supervisor:use_sim_time:=false"} < {
        *words
    }
    assert {"komo_optimiser:warm_up:=false", "waypoint_planner:warm_up:=true"} < {*words}
    assert "dry_run:=true" in apart["supervisor"] and words.index("--params-file") < words.index("-p")
