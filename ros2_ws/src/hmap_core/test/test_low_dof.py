"""Robots with fewer than six joints: which frames of a contact they reach, and what they push, pick and place."""

import time
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from low_dof_fixtures import write_robot, write_task

from hmap_core import plan_file
from hmap_core.contacts.candidates import CONTACT_GAP, on_surface
from hmap_core.contacts.feasibility import reachable
from hmap_core.contacts.grasp_axis import turned_grasps
from hmap_core.contacts.hand import hand_of
from hmap_core.contacts.push import push_reach
from hmap_core.contacts.solids import solids
from hmap_core.exceptions import Code, ContactError, PlannerError
from hmap_core.kinematics.arm import ALL_DIRECTIONS, load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner import plan, reachability
from hmap_core.planner.manipulation_graph.graph import ManipulationGraph
from hmap_core.planner.manipulation_graph.placements import Placement
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.strategies.manipulation_graph import ManipulationGraphStrategy
from hmap_core.planner.tilt import keeps_tilt, levelled, tilt_and_yaw
from hmap_core.scenes import load_robot_model, load_scene
from hmap_core.simulation.execute import execute
from hmap_core.transforms import IDENTITY, apply, from_matrix, from_rpy, interpolate, multiply, pose, rotation_matrix
from hmap_core.types import Body, BodyKind, ContactKind, ContactPoint, Goal, Robot, Scene, SegmentKind, Shape, ShapeKind
from hmap_core.validation import check
from hmap_core.waypoints import ObjectPathProblem
from hmap_core.waypoints.checker import Geometry, ObjectChecker
from hmap_core.waypoints.rrt import rrt_path
from hmap_core.waypoints.search import search_bounds
from hmap_core.waypoints.search_budget import SearchBudget

SEEDS = (0, 1, 2)
OFF = 1e-4  # m that a hand may be off a surface


def scene_of(tmp_path, task: str, robot: str, seed: int = 0) -> Scene:
    return load_scene(str(write_task(tmp_path, task, robot)), seed=seed)


def straight(scene: Scene, count: int = 8) -> np.ndarray:
    """Poses (count, 7) of the object straight to its goal."""
    return interpolate(scene.bodies[scene.goal.object].pose, scene.goal.pose, np.linspace(0.0, 1.0, count))


def sampled(scene: Scene, poses: np.ndarray) -> list[ContactPoint]:
    query = ContactQuery(scene, scene.start_state(), scene.goal.object, poses, "arm", np.random.default_rng(0))
    return list(next(iter(SampledContacts().propose(query))).contacts)


@pytest.mark.parametrize(("robot", "directions"), [("flat", 3), ("disc", 4), ("scara", 4), ("five", 5)])
def test_the_mobility_of_an_arm_is_the_rank_of_its_jacobian(tmp_path, robot, directions):
    assert load_arm(load_robot_model(str(write_robot(tmp_path, robot)))).mobility == directions


def test_an_arm_with_seven_joints_reaches_every_orientation():
    assert load_arm(load_robot_model("panda")).mobility == ALL_DIRECTIONS


@pytest.mark.parametrize(
    ("task", "robot"),
    [("puck", "disc"), ("puck", "flat"), ("puck", "stick"), ("puck", "five"), ("brick", "scara"), ("brick", "five")],
)
def test_sampled_contacts_are_within_the_mobility_of_the_arm(tmp_path, task, robot):
    """Each frame is reached at the start; the part of it that the contact constrains is kept."""
    scene = scene_of(tmp_path, task, robot)
    poses = straight(scene)
    contacts = sampled(scene, poses)
    assert len(contacts) >= 10
    manipulation = Manipulation(scene, scene.start_state(), "arm", scene.goal.object)
    ok, _ = reachable(manipulation, contacts, poses[0], np.random.default_rng(0))
    assert ok.sum() >= 10
    hand = hand_of(scene.robots["arm"])
    for contact in contacts:
        R = rotation_matrix(contact.T_obj_ee)
        if contact.kind == ContactKind.GRASP:
            assert abs(R[:, 1] @ contact.normal) == pytest.approx(1.0, abs=1e-6)
            middle = contact.point - 0.5 * contact.opening * contact.normal
            beside = np.cross(middle - contact.T_obj_ee[:3], R[:, 2])
            assert np.linalg.norm(beside) < OFF
        else:
            heights = (apply(contact.T_obj_ee, hand.tip) - contact.point) @ contact.normal - hand.tip_radius
            assert -1e-6 < heights.min() < CONTACT_GAP + OFF
            assert R @ contact.approach @ contact.normal < 0.0


@pytest.mark.parametrize("turn", ["0, 0, 0", "180, 0, 0", "0, 90, 0", "0, 0, 30", "20, 30, 40"])
@pytest.mark.parametrize("robot", ["paddle", "disc"])
def test_pushes_do_not_depend_on_how_the_hand_s_frame_is_turned(tmp_path, robot, turn):
    task, path = write_task(tmp_path, "crate", robot), tmp_path / f"{robot}.yaml"
    path.write_text(path.read_text().replace("{xyz: [0, 0, 0]}", f"{{xyz: [0, 0, 0], rpy_deg: [{turn}]}}"))
    scene = load_scene(str(task), seed=0)
    start = scene.bodies["crate"].pose
    poses = interpolate(start, multiply(start, pose((0.2, 0.0, 0.0))), np.linspace(0.0, 1.0, 8))
    contacts = sampled(scene, poses)
    assert len(contacts) >= 10 and {contact.kind for contact in contacts} == {ContactKind.PUSH}
    hand = hand_of(scene.robots["arm"])
    assert (push_reach(scene.bodies["crate"], hand, contacts, poses) == len(poses) - 1).sum() >= 10


def test_a_round_tip_touches_with_its_surface():
    R, point, normal = np.eye(3)[None], np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    origin, feature = on_surface(R, point, normal, np.zeros((1, 3)), np.array([0.02]))
    np.testing.assert_allclose(origin[0], [0.1, 0.02 + CONTACT_GAP, 0.0])
    assert feature.all()


def test_the_tip_of_a_stick_is_round(tmp_path):
    hand = hand_of(scene_of(tmp_path, "puck", "stick").robots["arm"])
    assert np.max(hand.tip_radius) == pytest.approx(0.012)


@pytest.mark.parametrize(
    ("shape", "turns"),
    [(Shape(ShapeKind.SPHERE, (0.02,)), True), (Shape(ShapeKind.BOX, (0.04, 0.04, 0.04)), False)],
)
def test_what_is_round_is_gripped_about_another_axis(tmp_path, shape, turns):
    hand = hand_of(scene_of(tmp_path, "brick", "scara").robots["arm"])
    grasp = ContactPoint(ContactKind.GRASP, IDENTITY, np.array([0.0, 0.02, 0.0]), np.eye(3)[1], 0.04, np.eye(3)[2])
    turn = np.eye(4)
    turn[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    everywhere = lambda points: np.ones(len(points), bool)  # noqa: E731
    (found,) = turned_grasps([grasp], turn[None, :3, :3], solids([(shape, IDENTITY)]), hand, everywhere)
    if not turns:
        assert found is grasp
        return
    np.testing.assert_allclose(found.T_obj_ee, from_matrix(turn), atol=1e-9)
    np.testing.assert_allclose(found.normal, turn[:3, 1], atol=1e-9)
    np.testing.assert_allclose(found.point, 0.02 * turn[:3, 1], atol=1e-6)
    assert found.opening == pytest.approx(0.04, abs=1e-6)


@pytest.mark.parametrize("level", [True, False])
def test_the_object_keeps_its_tilt_on_a_level_path(level):
    """Trees turn the object about the vertical only, at every height."""
    bar = Body("bar", BodyKind.MOVABLE, (Shape(ShapeKind.BOX, (0.1, 0.04, 0.04)),), IDENTITY)
    wall = Body("wall", BodyKind.FIXED, (Shape(ShapeKind.BOX, (0.02, 3.0, 0.4)),), pose((0.0, 0.0, 0.2)))
    start, goal = from_rpy((-0.2, 0.0, 0.1), (0.3, 0.0, 0.0)), from_rpy((0.2, 0.0, 0.1), (0.3, 0.0, 0.0))
    problem = ObjectPathProblem(bar, start, goal, (wall,), "spatial", level=level)
    checker = ObjectChecker(problem, Geometry(problem), False, 0.0)
    bounds = search_bounds(problem, checker)
    path = rrt_path(checker, [start], [goal], bounds, np.random.default_rng(0), SearchBudget(60.0), scale=8)
    tilts = np.array([tilt_and_yaw(start, T)[0] for T in path])
    assert np.ptp(path[:, 2]) > 0.2
    assert (tilts.max() < 1e-6) == level


def test_a_goal_is_not_called_out_of_reach_for_the_way_in_which_its_path_tilts(tmp_path):
    """An arm with five joints may follow a tilt about another axis than the path's, so nothing is decided."""
    scene = scene_of(tmp_path, "brick", "five")
    poses = interpolate(IDENTITY, from_rpy((0.3, 0.0, 0.0), (0.5, 0.0, 0.0)), np.linspace(0.0, 1.0, 8))
    asked = Mock()
    asked.find_contacts.side_effect = ContactError("none", Code.NO_CONTACT)
    context = Mock(scene=scene, record=Mock(code=Code.NO_CONTACT), components=Mock(contacts=asked))
    reachability.check_goal(context, Mock(subgoal=Mock(depth=0, goal=scene.goal), poses=poses))
    assert not asked.find_contacts.called


def test_a_goal_takes_the_tilt_of_the_start_within_its_tolerance():
    start, turned = from_rpy((0.0, 0.0, 0.0), (0.01, 0.0, 0.0)), from_rpy((0.1, 0.2, 0.3), (0.0, 0.0, 0.5))
    goal = Goal("brick", turned, rotation_tolerance=0.04)
    same = levelled(goal, start, 0.5)
    np.testing.assert_array_equal(same.pose[:3], turned[:3])
    assert tilt_and_yaw(start, same.pose) == pytest.approx((0.0, 0.5), abs=1e-6)
    assert levelled(goal, start, 0.1) is goal


def test_only_a_scene_without_an_arm_of_six_joints_keeps_tilts(tmp_path):
    scene = scene_of(tmp_path, "brick", "scara")
    panda = Robot("panda", load_robot_model("panda"), IDENTITY, load_robot_model("panda").home)
    assert keeps_tilt(scene)
    assert not keeps_tilt(replace(scene, robots=scene.robots | {"panda": panda}))
    assert not keeps_tilt(replace(scene, robots={}))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("robot", ["disc", "flat", "stick", "scara", "five"])
def test_a_puck_is_carried_round_a_wall(tmp_path, robot, seed):
    """A kinematic task, which is judged and not executed."""
    made = plan(scene_of(tmp_path, "puck", robot, seed), seed=seed)
    assert check(plan_file.to_dict(made)).valid
    assert any(segment.kind == SegmentKind.TOUCH for segment in made.segments)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("task", "robot", "kind"),
    [
        ("crate", "paddle", SegmentKind.PUSH),
        ("crate", "scara", SegmentKind.PUSH),
        ("crate", "five", SegmentKind.PUSH),
        ("brick", "scara", SegmentKind.GRASP),
        ("brick", "five", SegmentKind.GRASP),
        ("leaning", "scara", SegmentKind.GRASP),
        ("leaning", "five", SegmentKind.GRASP),
    ],
)
def test_a_robot_with_few_joints_pushes_picks_and_places(tmp_path, task, robot, kind, seed):
    """Planned, judged valid, and executed under dynamics."""
    made = plan(scene_of(tmp_path, task, robot, seed), seed=seed)
    assert check(plan_file.to_dict(made)).valid
    assert any(segment.kind == kind for segment in made.segments)
    report = execute(made)
    assert report.solved, report.reason


# --- what cannot be done

BRICK_GOAL = "goal: {object: brick, pose: {xyz: [0.42, 0.22, 0.04]}}"
ROOF = "  roof: {shape: box, size: [0.3, 0.3, 0.02], pose: {xyz: [0.42, 0.22, 0.11]}}\nmovable:"
CANNOT = {
    "beyond the arm": (
        (BRICK_GOAL, BRICK_GOAL.replace("0.42", "0.95")),
        "is out of reach of arm: no contact can bring it",
    ),
    "under a roof": (("movable:", ROOF), r"are with the hand in 'roof'"),
    "on its side": (
        (BRICK_GOAL, BRICK_GOAL.replace("0.04]}}", "0.02], rpy_deg: [90, 0, 0]}}")),
        r"is tilted by 90.0 deg from where it stands; allowed are 2.0 deg, for the hands of arm turn about",
    ),
}


@pytest.mark.parametrize(
    ("robot", "kind"), [("scara", kind) for kind in CANNOT] + [("five", "beyond the arm"), ("five", "under a roof")]
)
def test_what_an_arm_with_few_joints_cannot_do_is_told_before_long_searches(tmp_path, robot, kind, monkeypatch):
    def searched(*_):
        raise AssertionError("a graph of placements is searched")

    monkeypatch.setattr(ManipulationGraphStrategy, "solve", searched)
    (before, after), says = CANNOT[kind]
    path = write_task(tmp_path, "brick", robot)
    path.write_text(path.read_text().replace(before, after))
    began = time.thread_time()
    with pytest.raises(ContactError, match=says) as error:
        plan(load_scene(str(path), 0), seed=0, time_limit=60.0)
    assert error.value.code == Code.OUT_OF_REACH and time.thread_time() - began < 20.0  # s; a busy machine is slow


def test_a_search_of_placements_ends_with_its_time():
    calls = []

    def check_time():
        calls.append(1)
        if len(calls) > 3:
            raise PlannerError("no time is left", Code.TIME_LIMIT)

    nodes = [Placement.at(pose((0.1 * k, 0.0, 0.0))) for k in range(3)]
    graph = ManipulationGraph(nodes, [], Mock(motions=[]), np.random.default_rng(0), check_time=check_time)
    with pytest.raises(PlannerError, match="no time is left"):
        for _ in range(9):
            graph.cheapest()
