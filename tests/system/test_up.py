"""``hmap up`` as a user starts it: the tunnel is planned and executed, recorded, and everything ends."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest
import rclpy
from mcap.reader import make_reader
from rclpy.context import Context

import hmap
from hmap.commands.up import POLL
from hmap.session import SERVICES
from hmap_core.cli import main

START = 120.0  # s for a single node to be up on a busy machine
LIMIT = 400.0  # s on a busy machine
ORPHANED = 60.0  # s on a busy machine for nodes to end after the command was killed
RECORDED = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/world_state": "hmap_msgs/msg/WorldState",
    "/plan": "hmap_msgs/msg/Plan",
    "/object_clouds": "hmap_msgs/msg/ObjectClouds",
    "/scene": "hmap_msgs/msg/Scene",
    "/markers": "visualization_msgs/msg/MarkerArray",
    "/planner_status": "hmap_msgs/msg/PlannerStatus",
    "/clock": "rosgraph_msgs/msg/Clock",
}
# Reads a bag with nothing of hmap and ROS within reach: only the definitions in the bag say what is in it.
READER = """
import json, sys
from pathlib import Path
for name in ("rclpy", "hmap", "hmap_core", "hmap_msgs", "hmap_msgs_py"):
    sys.modules[name] = None
from rosbags.highlevel import AnyReader
counts, joints = {}, set()
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, raw in reader.messages():
        message = reader.deserialize(raw, connection.msgtype)
        counts[connection.topic] = counts.get(connection.topic, 0) + 1
        if connection.topic == "/plan":
            joints = {path.robot for path in message.trajectory.robots}
    types = {connection.topic: connection.msgtype for connection in reader.connections}
print(json.dumps({"counts": counts, "types": types, "robots": sorted(joints)}))
"""
SUNK = """
schema: 1
mode: physical
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
movable:
  box: {shape: box, size: [0.05, 0.05, 0.08], pose: {xyz: [0.5, -0.2, 0.04]}, mass: 0.3}
  can: {shape: cylinder, size: [0.03, 0.1], pose: {xyz: [0.5, 0.0, 0.03]}, mass: 0.3}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: box, pose: {xyz: [0.5, 0.2, 0.04]}}
"""


def command(*arguments: str) -> list[str]:
    return [str(Path(sys.executable).with_name("hmap")), *arguments]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of the tunnel: its folder and what came of the process."""
    out = tmp_path_factory.mktemp("runs")
    done = subprocess.run(
        command("up", "tunnel", "--seed", "1", "--out", str(out), "--speed", "0"),
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    (folder,) = out.iterdir()
    return folder, done


@pytest.mark.slow
def test_the_tunnel_is_solved(run):
    _, done = run
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "solved"
    found = {line[:16].strip() for line in lines[1:]}
    wanted = {"waypoints", "contacts", "mode switches", "planning time", "final error", "plan", "picture", "bag"}
    assert found >= wanted


@pytest.mark.slow
def test_progress_names_the_phases(run):
    _, done = run
    for phase in ("starting", "up", "waypoints", "contacts", "motion", "execution"):
        assert f"] {phase}" in done.stderr
    assert "] page: http://127.0.0.1:" in done.stderr


@pytest.mark.slow
def test_the_plan_passes_the_judge_and_is_executed_without_ros(run, capsys):
    folder, _ = run
    assert main(["check", str(folder / "plan.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["valid"] is True
    assert main(["execute", str(folder / "plan.json"), "--json"]) == 0


@pytest.mark.slow
def test_the_bag_opens_without_hmap_and_holds_the_run(run):
    folder, _ = run
    read = subprocess.run(
        [sys.executable, "-I", "-c", READER, str(folder / "bag")], capture_output=True, text=True, timeout=LIMIT
    )
    assert read.returncode == 0, read.stderr
    bag = json.loads(read.stdout)
    for topic, kind in RECORDED.items():
        assert bag["types"].get(topic) == kind
        assert bag["counts"].get(topic, 0) > 0, f"nothing on {topic}"
    assert bag["robots"] == ["panda_1", "panda_2"]


CONFIG = Path(hmap.__file__).resolve().parents[1] / "config"
PRIMITIVE = r"(bool|byte|char|w?string(<=\d+)?|u?int(8|16|32|64)|float(32|64))"
STANDARD = {  # topics for other programs, of types that these know
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/panda_1/robot_description": "std_msgs/msg/String",
    "/panda_2/robot_description": "std_msgs/msg/String",
    "/markers": "visualization_msgs/msg/MarkerArray",
    "/scene_markers": "visualization_msgs/msg/MarkerArray",
    "/points": "sensor_msgs/msg/PointCloud2",
    "/planned_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "/planned_path": "nav_msgs/msg/Path",
}


def layout_topics() -> dict[str, set[str]]:
    """The topics that each layout file names."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in CONFIG.iterdir() if path.is_file()}
    found = {name: set(re.findall(r"Value: (/\S+)", text)) for name, text in texts.items() if name.endswith(".rviz")}
    for name in (name for name in texts if name.endswith(".json")):
        strings = re.findall(r'"(/[^"]*)"', texts[name])
        found[name] = {re.split(r"[.\[]", text)[0] for text in strings}
        json.loads(texts[name])
    curves = [curve.get("name", "") for curve in ElementTree.fromstring(texts["plotjuggler.xml"]).iter("curve")]
    found["plotjuggler.xml"] = {"/" + curve.split("/")[1] for curve in curves}
    found["rerun_view.py"] = set(re.findall(r'"(/\w[^"]*)"', texts["rerun_view.py"]))
    return found


def missing_types(text: str) -> set[str]:
    """Message types that a schema uses and does not define."""
    parts = re.split(r"^=+$", text, flags=re.MULTILINE)
    defined = {match.group(1) for part in parts[1:] if (match := re.match(r"\s*MSG: (\S+)", part))}
    used = set()
    for line in "\n".join(re.sub(r"MSG: \S+", "", part) for part in parts).splitlines():
        kind = re.sub(r"\[.*?\]", "", line.split("#")[0].strip().split(" ")[0])
        if kind and not re.fullmatch(PRIMITIVE, kind):
            used.add(kind)
    return used - defined


@pytest.mark.slow
def test_every_topic_of_the_layouts_is_in_the_bag_with_its_whole_schema(run):
    """As other programs read it: with the library mcap, and nothing of hmap."""
    folder, _ = run
    types: dict[str, str] = {}
    for file in (folder / "bag").glob("*.mcap"):
        with file.open("rb") as stream:
            for schema, channel, _ in make_reader(stream).iter_messages():
                if channel.topic not in types:
                    assert schema.encoding == "ros2msg" and not missing_types(schema.data.decode()), channel.topic
                types[channel.topic] = schema.name
    layouts = layout_topics()
    assert set(layouts) == {"hmap.rviz", "foxglove.json", "lichtblick.json", "plotjuggler.xml", "rerun_view.py"}
    for name, topics in layouts.items():
        assert topics and topics <= set(types), f"{name}: {topics - set(types)}"
    assert {topic: types.get(topic) for topic in STANDARD} == STANDARD


LAST_WORDS = "import atexit, os\natexit.register(lambda: os.write(1, b'a library says goodbye'))\n"


@pytest.mark.slow
def test_json_is_all_that_is_on_standard_output_whatever_a_library_prints(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(LAST_WORDS)
    done = subprocess.run(
        command("up", "published/bolt", "--plan-only", "--no-picture", "--json", "--out", str(tmp_path / "runs")),
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])},
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    report = json.loads(done.stdout)
    assert done.returncode == 0 and "a library says goodbye" in done.stderr
    assert report["planned"] and not report["solved"] and report["reason"] is None and report["code"] is None
    assert Path(report["files"]["plan"]).is_file() and report["summary"]["task"] == "published/bolt, seed 0"


@pytest.mark.slow
def test_every_log_is_free_of_traces(run):
    folder, _ = run
    logs = {path.stem: path.read_text() for path in (folder / "logs").glob("*.log")}
    assert set(logs) >= set(SERVICES)
    assert not [name for name, text in logs.items() if "Traceback" in text or "exception" in text]


@pytest.mark.slow
def test_sigint_ends_everything_quietly(tmp_path):
    up = subprocess.Popen(
        command("up", "tunnel", "--out", str(tmp_path)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    lines = []
    for line in up.stderr:
        lines.append(line)
        if "] contacts" in line:
            break
    children = Path(f"/proc/{up.pid}/task/{up.pid}/children").read_text().split()
    up.send_signal(signal.SIGINT)
    _, rest = up.communicate(timeout=LIMIT)
    assert up.returncode == 0
    assert "Traceback" not in "".join(lines) + rest
    (folder,) = tmp_path.iterdir()
    assert not [p for p in (folder / "logs").glob("*.log") if "Traceback" in p.read_text()]
    time.sleep(0.5)
    assert not [pid for pid in children if os.path.exists(f"/proc/{pid}")]


@pytest.mark.slow
def test_nothing_is_left_over_where_the_command_itself_is_killed(tmp_path):
    up = subprocess.Popen(
        command("up", "published/bolt", "--out", str(tmp_path)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for line in up.stderr:
        if "] up" in line:
            break
    children = Path(f"/proc/{up.pid}/task/{up.pid}/children").read_text().split()
    up.kill()
    up.communicate(timeout=LIMIT)
    until = time.monotonic() + ORPHANED
    while left := [pid for pid in children if os.path.exists(f"/proc/{pid}")]:
        assert time.monotonic() < until, left
        time.sleep(POLL)


@pytest.mark.slow
def test_supervisor_and_planners_in_one_process_solve_the_tunnel(tmp_path):
    """And each of their services is there all the same."""
    up = subprocess.run(
        command("up", "tunnel", "--composed", "--no-viewer", "--no-picture", "--json", "--out", str(tmp_path)),
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert up.returncode == 0, up.stderr
    assert json.loads(up.stdout)["solved"]
    assert all(name in up.stderr for name in SERVICES)
    (folder,) = tmp_path.iterdir()
    logs = {path.stem: path.read_text() for path in (folder / "logs").glob("*.log")}
    assert set(logs) == {"composed_planning", "world", "perception", "recorder"}
    assert not [name for name, text in logs.items() if "Traceback" in text]


def test_an_unknown_task_is_refused_before_anything_starts(tmp_path):
    done = subprocess.run(
        command("up", "tunel", "--out", str(tmp_path / "runs")), capture_output=True, text=True, timeout=LIMIT
    )
    assert done.returncode == 2
    assert "input/UNKNOWN_TASK" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def test_so_is_one_in_which_bodies_are_in_each_other(tmp_path):
    task = tmp_path / "sunk.yaml"
    task.write_text(SUNK)
    done = subprocess.run(
        command("up", str(task), "--out", str(tmp_path / "runs")), capture_output=True, text=True, timeout=LIMIT
    )
    assert done.returncode == 2
    assert "input/START_IN_COLLISION" in done.stderr and "movable.can.pose" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_one_node_runs_in_the_foreground_until_sigint():
    node = subprocess.Popen(
        command("run", "waypoint_planner", "--ros-args", "-r", "__ns:=/cell"), stderr=subprocess.PIPE, text=True
    )
    with Context() as context:
        looking = rclpy.create_node("looking", context=context)
        until = time.monotonic() + START
        while "/cell/plan_waypoints" not in dict(looking.get_service_names_and_types()):
            assert node.poll() is None and time.monotonic() < until
            time.sleep(POLL)
        looking.destroy_node()
    node.send_signal(signal.SIGINT)
    _, err = node.communicate(timeout=LIMIT)
    assert node.returncode == 0
    assert "Traceback" not in err


MAPPED = """
import os, signal, sys, threading
from hmap.environment import prepare_process
prepare_process()
from hmap import node
from hmap.nodes import world
def segments():
    return [line.split()[-1] for line in open("/proc/self/maps") if "/dev/shm/fastrtps_" in line]
class World(world.WorldNode):
    def started(self):
        print(len(segments()) > 0)
        threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
code = node.run(World, [])
print(code, segments(), flush=True)
os._exit(0)  # as a process that was forked ends: nothing is cleaned up after this
"""


def test_a_node_returns_its_shared_memory_before_its_process_ends():
    done = subprocess.run([sys.executable, "-c", MAPPED], capture_output=True, text=True, timeout=LIMIT)
    assert {"True", "0 []"} <= set(done.stdout.splitlines()), done.stderr


@pytest.mark.parametrize(
    "arguments", [["nix"], ["world", "--ros-args", "-p", "task:=nix"], ["world", "--ros-args", "-p", "seed:=-1"]]
)
def test_a_node_with_wrong_arguments_is_bad_input(arguments):
    done = subprocess.run(command("run", *arguments), capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 2
    assert done.stderr.strip() and "Traceback" not in done.stderr
