"""What the page shows, without a browser: surfaces, recordings, the tree of a search, who may use the page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plan_fixtures import drag_plan
from simulation_fixtures import box
from simulation_fixtures import scene as simulated_scene

from hmap_core.cli import main
from hmap_core.kinematics.joint_poses import JointPoses
from hmap_core.robot_description import load_robot_description
from hmap_core.scenes import load_scene
from hmap_core.transforms import pose, to_matrix
from hmap_core.types import Goal, SegmentKind
from hmap_core.viewer.plan_drawing import contact_marks, ghost_poses
from hmap_core.viewer.recording import Recording, of_plan
from hmap_core.viewer.search_html import live_search, search_html
from hmap_core.viewer.server import same_origin
from hmap_core.viewer.surfaces import body_surface, link_surfaces, simplified


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


def test_poses_of_links_are_those_of_the_robot_description(scene):
    robot = scene.robots["panda_1"]
    joints = JointPoses(robot.model)
    tree = load_robot_description(robot.model.urdf).tree
    q, opening = robot.q + 0.1, 0.03
    relative = joints.fixed | joints.moving(q, opening)
    values = dict(zip(robot.model.joint_names, q, strict=True))
    values |= dict(zip(robot.model.gripper.joint_names, robot.model.gripper.joints(opening), strict=True))
    found = {joints.root: np.eye(4)}
    for link, parent in joints.parents.items():
        found[link] = found[parent] @ to_matrix(relative[link])
        np.testing.assert_allclose(found[link], tree.pose(link, values), atol=1e-9)
    assert set(found) == set(load_robot_description(robot.model.urdf).links)


def test_every_link_and_body_has_triangles_that_are_not_too_many(scene):
    for robot in scene.robots.values():
        surfaces = link_surfaces(robot.model)
        assert sum(len(parts) for parts in surfaces.values()) >= 10
        for parts in surfaces.values():
            for surface in parts:
                assert surface.faces.max() < len(surface.vertices) and len(surface.faces) < 20000
    for body in scene.bodies.values():
        vertices, faces = body_surface(body)
        assert np.isfinite(vertices).all() and faces.max() < len(vertices)


def test_a_simplified_mesh_stays_within_a_cell_of_the_mesh():
    rng = np.random.default_rng(0)
    vertices, faces = rng.uniform(-1.0, 1.0, (3000, 3)), rng.integers(0, 3000, (2000, 3))
    fewer, kept = simplified(vertices, faces, cells=10)
    assert len(fewer) < len(vertices) and kept.max() < len(fewer)
    assert np.abs(fewer).max() <= 1.0


def test_a_recording_is_linear_between_its_states(scene):
    start = scene.start_state()
    end = start.copy()
    end.q["panda_1"] = end.q["panda_1"] + 1.0
    end.poses["bar"] = end.poses["bar"] + np.array([0.2, 0, 0, 0, 0, 0, 0])
    recording = Recording("two", scene, [0.0, 2.0], [start, end])
    half = recording.state(1.0)
    np.testing.assert_allclose(half.q["panda_1"], start.q["panda_1"] + 0.5)
    np.testing.assert_allclose(half.poses["bar"][:3], start.poses["bar"][:3] + [0.1, 0, 0])
    np.testing.assert_array_equal(recording.state(-1.0).q["panda_1"], start.q["panda_1"])
    np.testing.assert_array_equal(recording.state(9.0).q["panda_1"], end.q["panda_1"])


def test_a_recording_takes_no_state_that_is_not_newer(scene):
    recording = Recording("run", scene)
    for time in (0.0, 1.0, 1.0, 0.5):
        recording.add(time, scene.start_state())
    assert recording.times == [0.0, 1.0]
    assert Recording("empty", scene).state(0.0).q.keys() == scene.robots.keys()


def test_a_plan_is_a_recording_with_its_contacts_marked():
    brick = box("box", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    goal = Goal("box", pose((0.5, 0.2, 0.03)))
    plan = drag_plan(simulated_scene(brick, goal=goal), "box", 0.06, np.array([0.0, 0.3, 0.0]))
    segments = tuple(replace(segment, contact_pose=pose()) if segment.object else segment for segment in plan.segments)
    plan = replace(plan, segments=segments, stats=plan.stats | {"search": {"what": "task", "solved": True}})
    recording = of_plan(plan)
    assert recording.duration == pytest.approx(plan.trajectory.time[-1])
    assert recording.plan(0.0) is plan and recording.search(0.0) == {"what": "task", "solved": True}
    contacts = [s for s in plan.segments if s.kind is not SegmentKind.TRANSIT]
    assert [mark.start for mark in contact_marks(plan)] == [s.start for s in contacts]
    assert ghost_poses(plan).shape[1] == 7


def test_the_tree_of_a_search_has_reasons_and_no_markup_of_others():
    failed = {"what": "try 1: <b>", "solved": False, "stage": "motion", "code": "NO_MOTION", "reason": "a & b"}
    html = search_html({"what": "waypoint 1", "solved": False, "tried": [failed, {"what": "try 2", "solved": True}]})
    assert "[motion/NO_MOTION] a &amp; b" in html and "&lt;b&gt;" in html and "<b>" not in html
    assert "no search" in search_html(None)
    wide = {"what": "all", "tried": [{"what": "one"}] * 5000}
    assert "more than" in search_html(wide) and len(search_html(wide)) < 200_000


def test_a_search_that_goes_on_is_grouped_by_waypoint():
    steps = [(0, 0, 0, "path"), (1, 9, 0, "contacts"), (1, 9, 1, "grasp"), (4, 9, 1, "push")]
    tree = live_search(steps, "motion")
    assert [entry["what"] for entry in tree["tried"]] == [
        "path of the object",
        "waypoint at pose 1 of 9",
        "waypoint at pose 4 of 9",
    ]
    assert tree["tried"][1]["tried"][1]["what"] == "try 1: grasp"


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({"Host": "127.0.0.1:8080"}, True),
        ({"Host": "localhost:8080", "Origin": "http://localhost:8080"}, True),
        ({"Host": "127.0.0.1:8080", "Origin": "http://evil.example"}, False),
        ({"Host": "127.0.0.1:8080", "Origin": "null"}, False),
        ({"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, False),
        ({}, False),
    ],
)
def test_pages_of_others_are_refused(headers, allowed):
    connection = SimpleNamespace(respond=lambda status, text: (int(status), text))
    answer = same_origin(lambda *_: "page", loopback=True)(connection, SimpleNamespace(headers=headers))
    assert answer == "page" if allowed else answer[0] == 403


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["nothing.json"], "no such file"),
        (["."], "bag"),
        (["plan.json", "other.json", "--html", "out.html"], "--html writes one"),
        (["plan.json", "--html", "missing/out.html"], "no folder"),
        (["plan.json"], "INVALID_PLAN_FILE"),
    ],
)
def test_what_cannot_be_viewed_is_bad_input(arguments, reason, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.json").write_text("{}")
    assert main(["view", *arguments]) == 2
    assert reason in capsys.readouterr().err
