"""Arms with fewer than six joints tilt objects over placements that suit them, or that is refused at once."""

import time

import numpy as np
import pytest
from low_dof_fixtures import write_robot, write_task

from hmap_core import plan_file
from hmap_core.exceptions import Code, ContactError
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner import plan
from hmap_core.planner.tilt import tilt_and_yaw
from hmap_core.planner.tilting import Tilting, missing_turns
from hmap_core.scenes import load_robot_model, load_scene
from hmap_core.simulation.execute import execute
from hmap_core.transforms import rotation_matrix
from hmap_core.types import Scene, SegmentKind
from hmap_core.validation import check

SIZE, GOAL, START = "size: [0.07, 0.04, 0.08]", "xyz: [0.42, 0.22, 0.04]}}", "pose: {xyz: [x, y, 0.04]"
ON_ITS_SIDE = "xyz: [0.42, 0.22, 0.02], rpy_deg: [90, 0, 0]}}"
ROOF = "  roof: {shape: box, size: [0.3, 0.3, 0.02], pose: {xyz: [0.42, 0.22, 0.11]}}\nmovable:"
TIME = 12.0  # s of CPU; it takes one or two on an idle machine


def scene_of(tmp_path, robot: str, *changes: tuple[str, str], seed: int = 0) -> Scene:
    path = write_task(tmp_path, "brick", robot)
    text = path.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    return load_scene(str(path), seed=seed)


def tilts(made) -> int:
    """How often the object is placed with another tilt than it was picked with."""
    poses = made.trajectory.objects["brick"]
    held = [s for s in made.segments if s.kind == SegmentKind.GRASP]
    ends = np.searchsorted(made.trajectory.time, [(s.start, s.end) for s in held])
    first, last = ends[:, 0].tolist(), np.minimum(ends[:, 1], len(poses) - 1).tolist()
    return sum(tilt_and_yaw(poses[a], poses[b])[0] > 0.5 for a, b in zip(first, last, strict=True))


@pytest.mark.parametrize(
    "goal",
    [
        ON_ITS_SIDE,
        "xyz: [0.42, 0.22, 0.035], rpy_deg: [0, 90, 0]}}",
        "xyz: [0.42, 0.22, 0.02], rpy_deg: [-90, 0, 130]}}",
        "xyz: [0.42, 0.22, 0.04], rpy_deg: [180, 0, 20]}}",
    ],
    ids=["on a side", "on another side", "turned too", "upside down"],
)
def test_an_arm_with_five_joints_tilts_an_object(tmp_path, goal):
    scene = scene_of(tmp_path, "five", (GOAL, goal))
    began = time.thread_time()
    made = plan(scene, seed=0, time_limit=60.0)
    assert time.thread_time() - began < TIME
    report = check(plan_file.to_dict(made))
    assert report.valid, report.violations


def test_a_tilt_is_found_from_every_yaw_and_executed(tmp_path):
    scene = scene_of(tmp_path, "five", (GOAL, ON_ITS_SIDE), seed=3)
    report = execute(plan(scene, seed=3, time_limit=60.0))
    assert report.solved, report.reason


CANNOT = {
    "no roll joint": ("four", [(GOAL, ON_ITS_SIDE)], r"4 of 6 directions, not about \(.*\) nor \(.*\) with its point"),
    "plate": (
        "five",
        [
            (SIZE, "size: [0.12, 0.02, 0.12]"),
            (START, "pose: {xyz: [x, y, 0.06]"),
            (GOAL, ON_ITS_SIDE.replace("2]", "1]")),
        ],
        r"of \d+ grasps of 'arm' \d+ are free for the hand as it stands, .* 5 of 6 directions, not about",
    ),
    "crate": (
        "five",
        [
            (SIZE, "size: [0.15, 0.12, 0.12]"),
            (START, "pose: {xyz: [x, y, 0.06]"),
            (GOAL, ON_ITS_SIDE.replace("0.02]", "0.06]")),
        ],
        "no gripper holds 'brick'",
    ),
    "roof": ("five", [(GOAL, ON_ITS_SIDE), ("movable:", ROOF)], r"no grasp on 'brick' serves both .* \(0.420, 0.220"),
    "beyond the arm": ("five", [(GOAL, ON_ITS_SIDE.replace("0.42", "0.95"))], "too far for the arm"),
}


@pytest.mark.parametrize("kind", CANNOT)
def test_a_tilt_that_an_arm_cannot_make_is_refused_soon_with_the_direction_that_it_lacks(tmp_path, kind):
    robot, changes, says = CANNOT[kind]
    began = time.thread_time()
    with pytest.raises(ContactError, match=says) as error:
        plan(scene_of(tmp_path, robot, *changes), seed=0, time_limit=60.0)
    assert error.value.code == Code.OUT_OF_REACH and time.thread_time() - began < TIME
    assert "is tilted by 90.0 deg from where it stands" in str(error.value)


def test_placements_for_a_tilt_are_reached_with_the_grasp(tmp_path):
    """The object stands upright at the one and lies at the other, wherever inverse kinematics turns it."""
    scene = scene_of(tmp_path, "five", (GOAL, ON_ITS_SIDE))
    state = scene.start_state()
    tilting = Tilting(scene, state, "brick", scene.goal.pose, np.random.default_rng(0), lambda: None)
    grasps = tilting.grasps(0, 1)
    assert grasps and grasps is tilting.grasps(0, 1)
    for grasp in grasps:
        for T, like in ((grasp.T_from, state.poses["brick"]), (grasp.T_to, scene.goal.pose)):
            np.testing.assert_allclose(rotation_matrix(T)[2], rotation_matrix(like)[2], atol=1e-4)
            assert T[2] == pytest.approx(like[2], abs=1e-4)


@pytest.mark.parametrize(("robot", "count"), [("five", 1), ("four", 2), ("scara", 2)])
def test_the_directions_about_which_a_hand_does_not_turn(tmp_path, robot, count):
    """By finite differences: no motion of the joints that keeps the hand's point turns it about them."""
    model = load_robot_model(str(write_robot(tmp_path, robot)))
    arm, rng = load_arm(model), np.random.default_rng(0)
    q = model.home + 0.1
    axes = missing_turns(arm, q)
    assert axes.shape == (count, 3)
    _, _, rows = np.linalg.svd(arm.tip_jacobian(q))
    rank = np.linalg.matrix_rank(arm.tip_jacobian(q))
    R = rotation_matrix(arm.end_effector(q))
    for _ in range(5):
        dq = rows[rank:].T @ rng.standard_normal(len(rows) - rank)
        turn = (rotation_matrix(arm.end_effector(q + 1e-6 * dq)) @ R.T - np.eye(3)) / 1e-6
        spin = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        np.testing.assert_allclose(axes @ spin, 0.0, atol=1e-4)
