"""The benchmark's judge against paths that are wrong in one known way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hmap_core.benchmark.instances import Attachment, MotionInstance, Target, box, scene_of
from hmap_core.benchmark.judge import judge, quaternions
from hmap_core.benchmark.problems.common import panda, table
from hmap_core.benchmark.sampling import end_effector
from hmap_core.benchmark.world import motion_world
from hmap_core.transforms import inverse, multiply, pose
from hmap_core.types import BodyKind, Goal
from hmap_core.validation.geometry import Gauge, transform

STEPS = 4
OPENING = 0.04
SWING = np.array([2.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # rad, about the upright axis: nothing changes its height


def instance(*bodies, attachments=(), between=None, **others) -> MotionInstance:
    """A Panda that swings by SWING and carries its attached objects along."""
    robot = panda()
    scene = scene_of("swing", 0, [table(), *bodies], [robot], Goal("table", pose()))
    end = between if between is not None else robot.q + SWING
    target = Target(robot.name, 0, end_effector(robot, end))
    return MotionInstance(scene, {robot.name: OPENING}, (STEPS,), (target,), tuple(attachments), **others)


def swing(task: MotionInstance, to: np.ndarray = SWING) -> np.ndarray:
    return task.start + np.linspace(0.0, 1.0, STEPS + 1)[:, None] * to


def attached_box(size=(0.03, 0.03, 0.03)):
    """A small box between the open fingers, and its attachment."""
    T = end_effector(panda(), panda().q)
    body = box("box", size, pose(T[:3], T[3:]), BodyKind.MOVABLE)
    return body, Attachment("panda", "box", 0, multiply(inverse(body.pose), T))


def wall(angle: float):
    """A thin plate that stands across the swing of the hand at an angle (rad)."""
    T = end_effector(panda(), panda().q)
    radius = np.hypot(*T[:2])
    turn = [0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)]
    return box("wall", (0.04, 0.004, 0.8), pose((radius * np.cos(angle), radius * np.sin(angle), 0.5), turn))


def test_a_right_path_is_accepted():
    body, attachment = attached_box()
    for task in (instance(), instance(body, attachments=[attachment]), instance(wall(-0.8))):
        assert judge(task, swing(task)) == []


def test_shape_numbers_and_start():
    task = instance()
    path = swing(task)
    assert "shape" in judge(task, path[1:])[0]
    assert judge(task, np.where(path > path[-1, 0] - 1e-9, np.nan, path))
    assert "does not start" in judge(task, path + 1e-3)[0]


def test_joint_limits():
    beyond = panda().model.position_limits[1, 0] + 0.01 - panda().q[0]
    task = instance(between=panda().q + [beyond, 0, 0, 0, 0, 0, 0])
    assert "joint 1 of panda beyond its limit" in judge(task, swing(task, np.array([beyond, 0, 0, 0, 0, 0, 0])))[0]


@pytest.mark.parametrize(
    "joint, error, wrong", [(0, 0.0035, True), (0, 0.0015, False), (6, 0.01, True), (6, 0.007, False)]
)
def test_targets_to_a_millimetre_and_half_a_degree(joint, error, wrong):
    """Joint 1 moves the hand by 0.55 m per rad, joint 7 only turns it."""
    task = instance()
    path = swing(task)
    path[-1, joint] += error
    assert bool(judge(task, path)) == wrong


def test_target_some_steps_before_the_end():
    task = instance()
    task = replace(task, targets=(replace(task.targets[0], before=2),))
    assert f"at step {STEPS - 2}" in judge(task, swing(task))[0]
    early = swing(task)
    early[-3:] = early[-1]
    assert judge(task, early) == []


def test_a_thin_wall_between_two_steps():
    """At the two steps beside it, configuration by configuration, nothing is wrong."""
    task = instance(wall(1.5 * SWING[0] / STEPS))
    path = swing(task)
    configuration = replace(task, targets=(), steps_per_phase=(1,), path=False)
    assert all(judge(configuration, np.array([task.start, row])) == [] for row in path[1:3])
    assert any("wall" in text and "overlap" in text for text in judge(task, path))


def test_the_arm_itself():
    folded = np.array([0.0, 1.7, 0.0, -3.0, 0.0, 0.0, 0.0])
    task = instance(between=folded)
    assert any("panda/" in t and t.count("panda/") == 2 for t in judge(task, swing(task, folded - panda().q)))


def test_an_attached_object_hits_what_the_arm_does_not():
    body, attachment = attached_box((0.03, 0.03, 0.3))
    T = end_effector(panda(), panda().q + SWING / 2)
    post = box("post", (0.02, 0.02, 0.1), pose(T[:3] - [0.0, 0.0, 0.13]))
    assert judge(instance(post), swing(instance(post))) == []
    found = judge(instance(body, post, attachments=[attachment]), swing(instance(post)))
    assert [text for text in found if "box and post" in text or "post and box" in text]


def test_leaving_the_support():
    body, attachment = attached_box()
    on_table = replace(attachment, support="table")
    level = instance(body, attachments=[on_table])
    assert judge(level, swing(level)) == []
    up = np.array([0.0, -0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    task = instance(body, attachments=[on_table], between=panda().q + up)
    assert any("box leaves table" in text for text in judge(task, swing(task, up)))


def test_a_single_configuration_is_judged():
    """The motion to the configuration is not judged."""
    task = instance(wall(SWING[0] / 2), path=False)
    task = replace(task, steps_per_phase=(1,))
    ends = swing(task)[[0, -1]]
    assert judge(task, ends) == []
    there = replace(instance(wall(SWING[0]), path=False), steps_per_phase=(1,))
    assert "deep in something else" in judge(there, ends)[0]


def test_rounded_boxes():
    """Two cubes corner to corner: the rounded ones are farther apart by 2 (sqrt(3) - 1) r."""
    far, r = 0.12, 0.005
    bodies = [box("a", (0.1,) * 3, pose()), box("b", (0.1,) * 3, pose((far,) * 3), BodyKind.MOVABLE)]
    found = []
    for rounding in (0.0, r):
        robot = panda(base=pose((5.0, 0.0, 0.0)))
        scene = scene_of("corners", 0, bodies, [robot], Goal("b", pose()))
        world = motion_world(scene, {robot.name: 0.0}, {robot.name: robot.q[None]}, rounding=rounding)
        a, b = (part for part in world.parts if part.link is None)
        gauge = Gauge(a.solid, b.solid)
        found.append(gauge.distance(transform(np.eye(3), np.zeros(3)), transform(np.eye(3), np.full(3, far))))
    assert found[0] == pytest.approx(np.sqrt(3) * 0.02, abs=1e-6)
    assert found[1] - found[0] == pytest.approx(2 * (np.sqrt(3) - 1) * r, abs=1e-6)


def test_quaternions_of_rotations():
    R = Rotation.random(50, random_state=0)
    q = quaternions(R.as_matrix())
    assert (Rotation.from_quat(q).inv() * R).magnitude().max() < 1e-7
    assert (np.sum(q[1:] * q[:-1], axis=1) >= 0.0).all()
