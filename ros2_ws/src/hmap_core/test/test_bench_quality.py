"""What ``hmap bench quality`` measures, on plans with known motions, and the command."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from hmap_core import plan_file
from hmap_core.benchmark.quality import medians, quality
from hmap_core.cli import main
from hmap_core.planner import plan
from hmap_core.scenes import load_scene
from hmap_core.types import BodyKind, Plan, Segment, SegmentKind, Trajectory

DT = 0.1


def made_of(*motions: tuple[SegmentKind, str | None, str | None, np.ndarray]) -> Plan:
    """A plan of the robot of bolt: kinds, objects, manipulators and joint paths (m, 7), one after the other."""
    scene = load_scene("bolt")
    robot = next(iter(scene.robots))
    rows, segments = [motions[0][3][:1]], []
    for kind, object, manipulator, q in motions:
        start = DT * (sum(map(len, rows)) - 1)
        rows.append(q[1:])
        end = DT * (sum(map(len, rows)) - 1)
        segments.append(Segment(start, end, robot, manipulator, object, kind, None))
    joints = np.concatenate(rows)
    trajectory = Trajectory(DT * np.arange(len(joints)), {robot: joints}, {robot: np.zeros(len(joints))}, {})
    return Plan(scene, trajectory, tuple(segments), np.zeros((0, 7)), {})


def line(*values: float) -> np.ndarray:
    return np.outer(values, np.eye(7)[0])


def test_a_plan_is_divided_into_free_loaded_and_standing():
    link = next(iter(load_scene("bolt").robots.values())).model.end_effector_link
    measured = quality(
        made_of(
            (SegmentKind.TRANSIT, None, None, line(0.0, 0.5, 1.0, 1.0)),
            (SegmentKind.GRASP, "bolt", link, line(1.0, 1.2, 1.4)),
            (SegmentKind.TRANSIT, None, None, line(1.4, 2.4, 1.9)),
        )
    )
    assert measured.duration == pytest.approx(0.7)
    assert (measured.free, measured.standing, measured.loaded) == pytest.approx((0.4, 0.1, 0.2))
    assert measured.detour == pytest.approx((1.0 + 3.0) / 2)  # one straight, one of 1.5 rad for 0.5 rad
    assert measured.swing == pytest.approx(1.0)
    assert measured.episodes == 1


def test_the_swing_of_a_tool_is_that_of_its_worst_motion():
    link = next(iter(load_scene("bolt").robots.values())).model.end_effector_link
    bodies = load_scene("bolt").bodies
    tool = next(name for name in bodies if name not in ("bolt", "table"))
    carried = made_of(
        (SegmentKind.GRASP, tool, link, line(0.0, 1.0, 0.5)), (SegmentKind.GRASP, "bolt", link, line(0.5, 3.0))
    )
    assert quality(carried).tool_swing == 0.0
    marked = carried.scene.bodies | {tool: replace(carried.scene.bodies[tool], kind=BodyKind.TOOL)}
    assert quality(replace(carried, scene=replace(carried.scene, bodies=marked))).tool_swing == pytest.approx(1.5)


def test_an_episode_ends_where_the_object_is_let_go():
    link = next(iter(load_scene("bolt").robots.values())).model.end_effector_link
    touch, push = (SegmentKind.GRASP, "bolt", link, line(0, 1)), (SegmentKind.PUSH, "nut", "bolt", line(1, 2))
    assert quality(made_of(touch, touch)).episodes == 1
    assert quality(made_of(touch, push, push)).episodes == 2
    assert quality(made_of(touch, push, touch, push)).episodes == 3
    assert quality(made_of(touch, (SegmentKind.TRANSIT, None, None, line(1, 2)), touch)).episodes == 2


def test_medians_are_of_each_attribute():
    one = quality(made_of((SegmentKind.TRANSIT, None, None, line(0.0, 0.5, 1.0))))
    found = medians([one, replace(one, duration=9.0), replace(one, duration=3.0)])
    assert found["duration"] == 3.0 and found["detour"] == 1.0


def test_the_command_writes_what_it_measures(tmp_path, capsys):
    file = tmp_path / "quality.json"
    assert main(["bench", "quality", "--tasks", "bolt", "--seeds", "2", "--json", str(file)]) == 0
    document = json.loads(file.read_text())
    assert list(document["bolt"]) == ["0", "1"]
    expected = quality(plan(load_scene("bolt", 1), seed=1))
    assert document["bolt"]["1"]["duration"] == expected.duration
    assert "bolt" in capsys.readouterr().out


def test_the_command_measures_plan_files(tmp_path, capsys):
    made, file = tmp_path / "made.json", tmp_path / "quality.json"
    plan_file.save(plan(load_scene("bolt", 1), seed=1), made)
    command = ["bench", "quality", "--plans", str(made), "--json", str(file)]
    assert main(command) == 0
    assert json.loads(file.read_text()) == {"bolt": {str(made): asdict(quality(plan_file.load(made)))}}
    assert main(["bench", "quality", "--plans", str(tmp_path / "none.json")]) != 0
    assert "none.json" in capsys.readouterr().err
