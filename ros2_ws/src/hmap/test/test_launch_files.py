"""The launch files start the nodes that the commands start, with parameters that the nodes have."""

from pathlib import Path

import launch_stand_in
import pytest
import rclpy
from rclpy.context import Context

from hmap.environment import share_path
from hmap.launcher.cell import PLANNING

FOLDER = Path(__file__).parents[1] / "launch"
EXECUTABLES = {path.stem for path in (FOLDER.parent / "hmap" / "nodes").glob("[a-z]*.py")}
PARAMETERS = {  # node -> those that the launch files may set
    "world": {"task", "seed", "real_time_factor", "announce_added"},
    "dynamic_obstacles": {"use_sim_time", "count", "seed"},
    "perception": {"use_sim_time", "task", "seed", "pose_noise"},
    "recorder": {"use_sim_time", "path"},
    "viewer": {"use_sim_time"},
    "supervisor": {"use_sim_time", "warm_up", "service_patience", "state_patience", "dry_run", "speed_scaling"},
} | {name: {"use_sim_time", "warm_up"} for name in PLANNING if name != "supervisor"}


def started(file: str, monkeypatch, **given: str) -> dict[str, tuple]:
    """Executable -> respawn, ROS arguments and parameters."""
    found = {}
    for node, words, values in launch_stand_in.load(FOLDER / file, monkeypatch).nodes(**given):
        assert node.package == "hmap" and node.executable in EXECUTABLES and node.executable not in found
        assert node.name in (node.executable, None)
        assert values.keys() <= PARAMETERS.get(node.executable, set()), node.executable
        found[node.executable] = node.respawn, words, values
    return found


@pytest.fixture
def cell(tmp_path) -> str:
    (tmp_path / "cell.yaml").write_text(
        "{task: tunnel, seed: 3, drivers: [ros2_control, vrpn_mocap], "
        "parameters: {supervisor: {speed_scaling: 0.3}, perception: {pose_noise: 0.002}}}"
    )
    return str(tmp_path / "cell.yaml")


def test_the_graph_with_the_simulated_world(monkeypatch):
    found = started("hmap.launch.py", monkeypatch)
    assert found.keys() == {"world", "perception", "recorder", "viewer", *PLANNING}
    assert found["world"][2] == {"task": "tunnel", "seed": 0, "real_time_factor": 4.0, "announce_added": True}
    assert found["supervisor"] == (
        False,
        ["__node:=supervisor"],
        {"use_sim_time": True, "warm_up": True, "service_patience": 30.0, "state_patience": 30.0},
    )
    assert {name for name, (respawn, *_) in found.items() if respawn} == {
        *("perception", "viewer", "komo_optimiser", "contact_proposer", "waypoint_planner")
    }


def test_the_graph_with_obstacles_and_without_a_world(monkeypatch):
    found = started("hmap.launch.py", monkeypatch, dynamic_obstacles="2", seed="5", viewer="false", record="false")
    assert found["dynamic_obstacles"][2] == {"use_sim_time": True, "count": 2, "seed": 5}
    assert not found["world"][2]["announce_added"] and not {"viewer", "recorder"} & found.keys()
    found = started("hmap.launch.py", monkeypatch, simulate="false", task="clutter")
    assert found["perception"][2] == {"use_sim_time": False, "task": "clutter", "seed": 0} and "world" not in found


def test_a_cell(monkeypatch, cell):
    found = started("cell.launch.py", monkeypatch, cell=cell, dry_run="true", bag="there")
    assert found.keys() == {"perception", "recorder", "viewer", *PLANNING}
    respawn, words, values = found["supervisor"]
    assert not respawn and [Path(word).name for word in words[2::2]] == ["ros2_control.yaml", "vrpn_mocap.yaml"]
    assert values == {
        **{"use_sim_time": False, "warm_up": True, "service_patience": 30.0, "state_patience": 30.0},
        **{"speed_scaling": 0.3, "dry_run": True},
    }
    assert found["perception"][2] == {"use_sim_time": False, "task": "tunnel", "seed": 3, "pose_noise": 0.002}
    assert found["recorder"][2]["path"] == "there"


def test_each_process_of_a_cell_gets_its_enclave(monkeypatch, cell):
    found = started("cell.launch.py", monkeypatch, cell=cell, enclaves="/hmap")
    assert all(words[:2] == ["--enclave", f"/hmap/{name}"] for name, (_, words, _) in found.items())
    assert not any("--enclave" in words for _, words, _ in started("cell.launch.py", monkeypatch, cell=cell).values())


@pytest.mark.parametrize("file", ["hmap.launch.py", "cell.launch.py"])
def test_supervisor_and_planners_in_one_process_get_their_own_parameters(monkeypatch, cell, file):
    given = {"cell": cell} if file == "cell.launch.py" else {}
    found = started(file, monkeypatch, composed="true", **given)
    assert not found.keys() & set(PLANNING)
    respawn, words, values = found["composed_planning"]
    assert not respawn and not values and not any("__node" in word for word in words)
    context = Context()  # as rcl reads them
    rclpy.init(args=["--ros-args", *words], context=context)
    rclpy.shutdown(context=context)
    set_ = {word for word in words if ":=" in word}
    assert {f"{name}:warm_up:=true" for name in PLANNING} <= set_ and "supervisor:service_patience:=30.0" in set_
    if given:  # files come first, since what comes last wins
        assert words[0] == "--params-file" and words[1] == str(share_path("params/ros2_control.yaml").absolute())
        assert {"supervisor:speed_scaling:=0.3", "komo_optimiser:use_sim_time:=false"} <= set_
    else:
        assert "supervisor:use_sim_time:=true" in set_
