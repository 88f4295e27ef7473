"""``hmap up`` with tasks for two robots: one passes a bar to the other, and both carry one together; with a bag."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_up import LIMIT, command

from hmap_core.plan_file import load
from hmap_core.types import SegmentKind
from hmap_core.validation import check

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
TASKS = ("hand_over", "two_arms")
TOGETHER = 0.05  # s that two arms may be apart in their common motion
PERIOD = 0.15  # s of simulated time, at most, between two joint states
SEARCH, STEP = 0.4, 0.005  # s round a guess in which the start of a motion is searched
# Reads the joint states of a bag with nothing of hmap and ROS within reach.
READER = """
import json, sys
from pathlib import Path
for name in ("rclpy", "hmap", "hmap_core", "hmap_msgs", "hmap_msgs_py"):
    sys.modules[name] = None
from rosbags.highlevel import AnyReader
joints, plans, bodies = {}, 0, {}
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, raw in reader.messages():
        if connection.topic == "/joint_states":
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            for name, position in zip(message.name, message.position):
                joints.setdefault(name, []).append((stamp, position))
        if connection.topic == "/plan":
            message = reader.deserialize(raw, connection.msgtype)
            plans += len({segment.robot for segment in message.segments if segment.kind == "grasp"}) == 2
print(json.dumps({"joints": joints, "plans": plans}))
"""


@pytest.fixture(scope="module", params=TASKS)
def run(request, tmp_path_factory):
    """A run of a task: its name, its folder, and what came of the process."""
    out = tmp_path_factory.mktemp("runs")
    done = subprocess.run(
        command("up", str(EXAMPLES / f"{request.param}.yaml"), "--out", str(out), "--speed", "0", "--no-picture"),
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    (folder,) = out.iterdir()
    return request.param, folder, done


@pytest.fixture(scope="module")
def bag(run):
    """What the bag of a run has of joints and plans."""
    read = subprocess.run(
        [sys.executable, "-I", "-c", READER, str(run[1] / "bag")], capture_output=True, text=True, timeout=LIMIT
    )
    assert read.returncode == 0, read.stderr
    return json.loads(read.stdout)


@pytest.mark.slow
def test_the_task_is_solved_by_two_hands_on_the_object(run):
    name, folder, done = run
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "solved"
    plan = load(folder / "plan.json")
    assert check(json.loads((folder / "plan.json").read_text())).valid
    grasps = [s for s in plan.segments if s.kind == SegmentKind.GRASP]
    both = [(a, b) for a in grasps for b in grasps if a.robot < b.robot and a.start <= b.end and b.start <= a.end]
    assert both
    together = [a for a, b in both if (a.start, a.end) == (b.start, b.end) and moves(plan, a)]
    assert bool(together) is (name == "two_arms")


@pytest.mark.slow
def test_the_service_plans_what_two_robots_do(run):
    _, folder, _ = run
    logs = {path.stem: path.read_text() for path in (folder / "logs").glob("*.log")}
    assert not [name for name, text in logs.items() if "Traceback" in text]


@pytest.mark.slow
def test_the_bag_holds_the_run(run, bag):
    _, folder, _ = run
    plan = load(folder / "plan.json")
    assert bag["plans"] >= 1  # more, where a stop in between was answered with a new plan
    for name, q in plan.trajectory.joints.items():
        moved = np.ptp(q, axis=0)
        for joint, planned in zip(plan.scene.robots[name].model.joint_names, moved, strict=True):
            stamps, measured = np.transpose(bag["joints"][f"{name}_{joint}"])
            assert np.diff(stamps).max() < PERIOD
            assert np.ptp(measured) == pytest.approx(planned, abs=0.05)


@pytest.mark.slow
def test_both_arms_set_out_together(run, bag):
    name, folder, _ = run
    if name != "two_arms":
        return
    plan = load(folder / "plan.json")
    segment = next(s for s in plan.segments if s.kind == SegmentKind.GRASP and moves(plan, s))
    starts = [started(plan, bag, robot, segment) for robot in plan.scene.robots]
    assert abs(starts[0] - starts[1]) < TOGETHER


def moves(plan, segment) -> bool:
    """Whether the object of a segment moves in it."""
    time, poses = plan.trajectory.time, plan.trajectory.objects[segment.object]
    return bool(np.ptp(poses[(time >= segment.start) & (time <= segment.end), :3], axis=0).max() > 0.01)


def started(plan, bag, robot: str, segment) -> float:
    """When (s of the bag's clock) a robot began a segment, by the best fit of its joints."""
    time, names = plan.trajectory.time, plan.scene.robots[robot].model.joint_names
    rows = (time >= segment.start) & (time <= segment.end)
    t, q = time[rows] - segment.start, plan.trajectory.joints[robot][rows]
    tables = [np.array(bag["joints"][f"{robot}_{joint}"]) for joint in names]
    stamps = tables[0][:, 0]
    measured = np.column_stack([np.interp(stamps, *table.T) for table in tables])
    middle = len(t) // 2
    guess = stamps[np.linalg.norm(measured - q[middle], axis=1).argmin()] - t[middle]

    def off(start: float) -> float:
        during = (stamps >= start) & (stamps <= start + t[-1])
        planned = np.column_stack([np.interp(stamps[during] - start, t, column) for column in q.T])
        return float(np.abs(planned - measured[during]).mean())

    return min(guess + np.arange(-SEARCH, SEARCH, STEP), key=off)
