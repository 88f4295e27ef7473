"""Recorded runs are measured: also failed and killed ones, and those of hardware without ground truth."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from execution_scenarios import BY, ROBOT, dragging
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from hmap.bags.reader import open_bag
from hmap.bags.runs import runs_in, wire_names
from hmap.bags.writer import BagWriter
from hmap.commands import bag as bag_command
from hmap.commands import compare as compare_command
from hmap.commands import evaluate as evaluate_command
from hmap.conversions import plan_to_message, scene_to_message, state_to_message
from hmap_core.cli.main import main
from hmap_core.evaluation import recorded
from hmap_core.exceptions import InputError
from hmap_core.trajectory.samples import state_at
from hmap_core.types import Plan, SegmentKind
from hmap_msgs.msg import PlannerStatus
from hmap_msgs_py.definitions import typestore
from hmap_msgs_py.poses import pose_to_message
from hmap_msgs_py.times import time_to_message

TYPES = {
    "/scene": "hmap_msgs/msg/Scene",
    "/plan": "hmap_msgs/msg/Plan",
    "/planner_status": "hmap_msgs/msg/PlannerStatus",
    "/world_state": "hmap_msgs/msg/WorldState",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/vicon/box/box": "geometry_msgs/msg/PoseStamped",
}
BEGIN = 10.0  # s of the clock at which the execution begins
PLANNING = 1.5  # s
STEP = 3  # samples of the plan between two measurements


def planned() -> Plan:
    """The box is dragged by a grasp from above."""
    plan = dragging()
    above = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    segments = [replace(s, contact_pose=above) if s.kind == SegmentKind.GRASP else s for s in plan.segments]
    return replace(plan, segments=tuple(segments))


class Record:
    """Writes the bag of an execution that follows its plan."""

    def __init__(self, path, slower: float = 1.0, offset: float = 0.0):
        self.plan, self.slower, self.offset = planned(), slower, np.r_[0.0, offset, np.zeros(5)]
        self.writer, self._connections, self._types = BagWriter(path), {}, typestore()

    def write(self, topic: str, time: float, message) -> None:
        if topic not in self._connections:
            self._connections[topic] = self.writer.add(topic, TYPES[topic], self._types)
        self.writer.write(self._connections[topic], int(time * 1e9), serialize_message(message))

    def status(self, time: float, phase: str, elapsed: float, text: str = "") -> None:
        message = PlannerStatus(phase=phase, elapsed=elapsed, text=text)
        message.header.stamp = time_to_message(time)
        self.write("/planner_status", time, message)

    def planned(self, scene: bool = True) -> None:
        if scene:
            self.write("/scene", 8.0, scene_to_message(self.plan.scene))
        self.status(8.1, "idle", 0.0)
        self.status(8.2, "waypoints", 0.1)
        self.status(9.0, "contacts", 1.0)
        self.write("/plan", 9.8, plan_to_message(self.plan, time_to_message(9.8)))
        self.status(BEGIN, "execution", PLANNING)

    def executed(self, share: float = 1.0, wire: str = "", states_every: int = 1, begin: float = 0.0) -> float:
        """Follow a share of the plan; returns the time of its end.

        Args:
            share: of the plan.
            wire: pattern of the joints' names in ``joint_states``; without it, there are only world states.
            begin: share of the plan at which it begins.
            states_every: with ``wire`` and if not 1, a world state comes with every so many joint states.
        """
        time = self.plan.trajectory.time
        joints = self.plan.scene.robots[ROBOT].model.joint_names
        for k in range(STEP * round(begin * len(time) / STEP), int(share * len(time)), STEP):
            at, state = BEGIN + self.slower * time[k], state_at(self.plan, k)
            state.poses["box"] = state.poses["box"] + self.offset
            if wire and k % (STEP * states_every) == 0 and states_every > 1:
                self.write("/world_state", at, state_to_message(self.plan.scene, state, time_to_message(at)))
            if wire:
                names = [wire.format(number=i + 1) for i in range(len(joints))]
                message = JointState(name=names, position=state.q[ROBOT].tolist())
                pose = PoseStamped(pose=pose_to_message(state.poses["box"]))
                message.header.stamp = pose.header.stamp = time_to_message(at)
                self.write("/joint_states", at, message)
                self.write("/vicon/box/box", at, pose)
            else:
                self.write("/world_state", at, state_to_message(self.plan.scene, state, time_to_message(at)))
        return at


def solved(path, **options):
    record = Record(path, **options)
    record.planned()
    end = record.executed()
    record.status(end, "done", PLANNING + end - BEGIN)
    record.writer.close()
    return record


def killed(folder, share: float) -> None:
    """The bag of a recorder that was killed after a share of the plan, in ``bag``."""
    record = Record(folder / "open")
    record.planned()
    record.executed(share)
    record.writer.flush()
    shutil.copytree(folder / "open", folder / "bag")


def metrics(path, judge: bool = False):
    (run,) = runs_in(open_bag(path))
    return recorded.measure(run, judge)


def test_a_run_that_follows_its_plan(tmp_path):
    plan = solved(tmp_path / "bag").plan
    found = metrics(tmp_path / "bag", judge=True)
    duration, q = plan.trajectory.time[-1], plan.trajectory.joints[ROBOT]
    assert (found.outcome, found.code, found.missing, found.faults) == ("solved", "", [], [])
    assert (found.task, found.seed) == (plan.scene.task, plan.scene.seed)
    assert found.planning_s == PLANNING and found.execution_s == pytest.approx(duration, abs=0.1)
    assert found.phases == pytest.approx({"waypoints": 0.9, "contacts": 0.5, "execution": duration}, abs=0.1)
    assert found.joint_path_rad == pytest.approx(np.linalg.norm(np.diff(q, axis=0), axis=1).sum(), rel=0.02)
    assert found.tip_path_m == pytest.approx(0.15 + 0.05 + np.linalg.norm(BY) + 0.15, abs=0.5)
    assert found.contact_switches == 1 and found.replans == 0 and found.plans == 1
    assert found.drift_joints_rad < 1e-6 and found.drift_object_m < 1e-6
    assert found.goal_error_m < 1e-3 and found.jerk_rad_s3 > 0.0
    assert -0.002 < found.clearance_m < 0.1


def test_drift_and_duration_are_those_of_the_execution(tmp_path):
    solved(tmp_path / "bag", slower=2.0, offset=0.02)
    found = metrics(tmp_path / "bag")
    assert found.execution_s == pytest.approx(2.0 * dragging().trajectory.time[-1], abs=0.2)
    assert found.drift_object_m == pytest.approx(0.02, abs=1e-3) and found.drift_joints_rad < 1e-6
    assert found.goal_error_m == pytest.approx(0.02, abs=2e-3)


def test_a_run_of_hardware_without_a_world_state(tmp_path):
    record = Record(tmp_path / "bag")
    record.planned()
    record.status(record.executed(wire="fr3_joint{number}"), "done", 20.0)
    record.writer.close()
    found = metrics(tmp_path / "bag")
    assert found.outcome == "solved" and found.joint_path_rad > 0.5 and found.drift_joints_rad < 1e-6
    assert found.goal_error_m < 1e-3 and found.contact_switches == 1
    assert any("/world_state (without it: " in text for text in found.missing)


def test_joints_that_come_more_often_than_states_give_lengths_and_jerk(tmp_path):
    record = Record(tmp_path / "bag")
    record.planned()
    record.status(record.executed(wire="joint{number}", states_every=15), "done", 20.0)
    record.writer.close()
    (run,) = runs_in(open_bag(tmp_path / "bag"))
    assert len(run.joints.time) > 10 * len(run.measured.time) and np.diff(run.joints.time).min() > 0.019
    solved(tmp_path / "often")
    found, often = recorded.measure(run), metrics(tmp_path / "often", judge=True)
    assert found.jerk_rad_s3 == pytest.approx(often.jerk_rad_s3, rel=0.2)
    for name in ("joint_path_rad", "tip_path_m", "moving_s"):
        assert getattr(found, name) == pytest.approx(getattr(often, name), rel=0.05), name
    # between states that are a second apart, the motion is not a straight line
    assert found.clearance_m == pytest.approx(often.clearance_m, abs=5e-4)


def test_a_failed_run_and_what_was_missing(tmp_path):
    record = Record(tmp_path / "bag")
    record.planned(scene=False)
    end = record.executed(0.5)
    record.status(end, "replanning", 5.0, "'box' slipped")
    record.status(end + 2.0, "execution", 7.5)
    record.status(end + 3.0, "failed", 9.0, "[execution/OBJECT_DROPPED] 'box' is lost")
    record.writer.close()
    found = metrics(tmp_path / "bag")
    assert (found.outcome, found.code) == ("failed", "OBJECT_DROPPED")
    assert found.replans == 1 and found.replan_latency_s == [2.5]
    assert any("'box' slipped" in text for text in found.faults)
    assert any(text.startswith("/scene (without it: ") for text in found.missing)


def test_the_bag_of_a_killed_recorder_is_cut_off(tmp_path):
    killed(tmp_path, 0.6)
    found = metrics(tmp_path / "bag")
    assert found.outcome == "cut off" and "phase 'execution'" in found.reason
    assert found.goal_error_m is None  # nobody knows where it ended
    assert found.joint_path_rad > 0.2 and any("no index" in text for text in found.missing)


def test_a_run_goes_on_in_the_bag_of_the_recorder_that_was_started_anew(tmp_path):
    killed(tmp_path, 0.5)
    rest = Record(tmp_path / "bag-2")
    rest.write("/scene", 12.6, scene_to_message(rest.plan.scene))
    rest.write("/plan", 12.6, plan_to_message(rest.plan, time_to_message(9.8)))  # latched
    rest.status(12.6, "execution", PLANNING + 2.6)
    end = rest.executed(begin=0.55)
    rest.status(end, "done", PLANNING + end - BEGIN)
    rest.writer.close()
    solved(tmp_path / "whole")
    whole = metrics(tmp_path / "whole", judge=True)
    found, problems = evaluate_command.measured([tmp_path / "bag", tmp_path / "bag-2"])
    assert [(m.outcome, m.plans) for m in found] == [("solved", 1)] and not problems
    assert any("the run goes on in" in text and "bag-2" in text for text in found[0].missing)
    for name in ("planning_s", "execution_s", "joint_path_rad", "contact_switches", "goal_error_m"):
        assert getattr(found[0], name) == pytest.approx(getattr(whole, name), rel=0.02), name
    alone = metrics(tmp_path / "bag-2", judge=True)
    assert alone.outcome == "solved" and alone.execution_s is None and alone.contact_switches is None
    assert alone.drift_joints_rad < 1e-6 and alone.clearance_m == pytest.approx(whole.clearance_m, abs=1e-3)
    assert any("begins in the phase 'execution'" in text for text in alone.missing)


def test_several_goals_in_one_bag(tmp_path):
    record = Record(tmp_path / "bag")
    for k in range(2):
        record.status(1.0 + k, "waypoints", 0.1)
        record.status(1.5 + k, "done", 0.5)
    record.writer.close()
    found = [recorded.measure(run) for run in runs_in(open_bag(tmp_path / "bag"))]
    assert [(m.goal, m.outcome) for m in found] == [(1, "planned"), (2, "planned")]


def test_a_bag_without_a_run_is_refused_with_what_it_lacks(tmp_path):
    record = Record(tmp_path / "bag")
    record.executed(0.2)
    record.writer.close()
    with pytest.raises(InputError, match="no run in this bag; it lacks /planner_status"):
        runs_in(open_bag(tmp_path / "bag"))


@pytest.mark.parametrize(
    ("names", "alone", "found"),
    [
        (["left_a", "left_b"], False, ["left_a", "left_b"]),
        (["b", "a", "finger1"], False, ["a", "b"]),
        (["fr3_joint2", "fr3_joint1", "fr3_finger_joint1"], True, ["fr3_joint1", "fr3_joint2"]),
        (["fr3_joint2", "fr3_joint1"], False, None),
        (["x", "y"], True, None),
    ],
)
def test_joints_are_found_by_the_names_of_drivers(names, alone, found):
    assert wire_names("left", ["a", "b"], set(names), alone) == found


def finished(number: int, seed: int, outcome: str = "solved", **values) -> recorded.RunMetrics:
    return recorded.RunMetrics(f"runs/{number}/bag", 1, "tunnel", seed, outcome, **values)


def test_runs_that_were_cut_off_do_not_shorten_the_means_and_are_numbered_in_what_is_told():
    runs = [finished(1, 0, execution_s=20.0), finished(2, 1, execution_s=22.0)]
    runs.append(finished(3, 2, "cut off", reason="the bag ends", execution_s=1.0, missing=["no index"]))
    (line,) = [line for line in recorded.intervals(runs) if line.startswith("execution_s")]
    assert line.split()[1] == "21" and line.endswith("n=2, those that ended well")
    assert recorded.remarks(runs) == ["run 3: cut off: the bag ends", "run 3: missing: no index"]
    assert recorded.remarks([finished(k, 0, missing=["no scene"]) for k in (1, 2)]) == ["all runs: missing: no scene"]
    assert recorded.names_of(runs) == ["1", "2", "3"]
    assert recorded.names_of([runs[0], replace(runs[0], goal=2)]) == ["1", "1 #2"]
    assert [row.split()[0] for row in recorded.table(runs)[1:]] == ["1", "2", "3"]


# the commands


@pytest.fixture
def commands(monkeypatch):
    """The commands as of this source tree, whatever is installed."""
    modules = {"evaluate": evaluate_command, "compare": compare_command, "bag": bag_command}
    names = {name: module.__name__ for name, module in modules.items()}
    monkeypatch.setattr(sys.modules["hmap_core.cli.main"], "_module_names", lambda: names)


def test_evaluate_prints_a_table_and_writes_pictures_and_a_page(tmp_path, commands, capsys):
    for k in range(2):
        solved(tmp_path / "runs" / str(k) / "bag")
    out = [str(tmp_path / "plots"), str(tmp_path / "report.html")]
    assert main(["evaluate", str(tmp_path / "runs"), "--plots", out[0], "--html", out[1], "--no-clearance"]) == 0
    text = capsys.readouterr().out
    assert text.count("solved") >= 3 and "2 of 2" in text and "execution_s" in text
    page = (tmp_path / "report.html").read_text()
    assert "data:image/png;base64," in page and "http" not in page and "2 recorded runs" in page
    assert {"phases.png", "execution_s.png"} <= {file.name for file in (tmp_path / "plots").iterdir()}
    assert main(["evaluate", str(tmp_path / "runs" / "0" / "bag"), "--json", "--no-clearance"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["outcome"] == "solved" and run["clearance_m"] is None


def test_compare_refuses_to_conclude_on_two_runs_each(tmp_path, commands, capsys):
    for name, slower in (("a", 1.0), ("b", 1.2)):
        for k in range(2):
            solved(tmp_path / name / str(k) / "bag", slower=slower)
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--no-clearance"]) == 1
    text = capsys.readouterr().out
    assert "too few runs to conclude anything" in text and "1.2" in text
    assert "1 pair of the same task and seed; with 8" in text


def test_compare_finds_a_slower_set_in_files_of_evaluate(tmp_path, commands, capsys):
    rng = np.random.default_rng(0)
    for name, scale in (("a", 1.0), ("b", 1.2)):
        runs = [
            recorded.RunMetrics("bag", 1, "tunnel", k, "solved", execution_s=scale * t)
            for k, t in enumerate(rng.normal(20.0, 1.0, 6))
        ]
        (tmp_path / f"{name}.json").write_text(json.dumps({"runs": [run.to_dict() for run in runs]}))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["differing"] == ["execution_s"]
    main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")])
    assert "6 pairs of the same task and seed" in capsys.readouterr().out
    (tmp_path / "a.json").write_text("{}")
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 2
    assert "is no file of `hmap evaluate --json`" in capsys.readouterr().err


def test_compare_finds_a_slower_set_by_pairs_where_tasks_differ_more_than_the_sets(tmp_path, commands, capsys):
    for name, scale in (("a", 1.0), ("b", 1.2)):
        runs = [
            finished(k, k, execution_s=scale * t) for k, t in enumerate((15.0, 24.0, 18.0, 33.0, 20.0, 9.0, 40.0, 12.0))
        ]
        (tmp_path / f"{name}.json").write_text(json.dumps({"runs": [run.to_dict() for run in runs]}))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 0
    text = capsys.readouterr().out
    assert "they differ in execution_s" in text and "1.200" in text and "8 pairs" in text
    assert "of the same task and seed" not in text


def test_bag_check_says_what_is_missing(tmp_path, commands, capsys):
    solved(tmp_path / "bag")
    assert main(["bag", "check", str(tmp_path / "bag")]) == 0
    assert capsys.readouterr().out.strip().endswith("\nsound")
    record = Record(tmp_path / "other")
    record.status(1.0, "done", 1.0)
    record.writer.close()
    assert main(["bag", "check", str(tmp_path / "other"), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert not report["sound"] and [text.split()[0] for text in report["missing"]] == [
        "/plan",
        "/scene",
        "/world_state",
        "/joint_states",
    ]
    assert main(["bag", "check", str(tmp_path / "none")]) == 2
    assert main(["evaluate", str(tmp_path / "none")]) == 2
