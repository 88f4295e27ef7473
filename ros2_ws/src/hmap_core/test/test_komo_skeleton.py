"""Skeletons: from who touches and holds what, to paths that the judge's geometry finds free."""

import numpy as np
from skeleton_fixtures import TIP, TWO_ARMS, contact, depth, scene

from hmap_core.komo.skeleton import ModeSwitch, Skeleton, SkeletonEntry
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import distance, from_rpy, inverse, multiply, pose
from hmap_core.types import ContactKind

PENETRATION = 1e-3  # m, what the judge allows
DOWN = (0, 0, -1)
BRICK = (0.05, 0.05, 0.08)
OPEN = 0.066  # m, the brick and 8 mm at each side


def entry(phase0, phase1, symbol, *frames, target=None):
    return SkeletonEntry(phase0, phase1, symbol, frames, target)


def solved(problem):
    result = problem.solve(problem.workspace.start)
    assert result.feasible, result.worst
    return result.path


def grasp(height=0.02, closing=(0, -1, 0)):
    return contact(ContactKind.GRASP, DOWN, closing, (0, 0, height), BRICK[1])


def pick_and_place(robot, goal, contact):
    return [
        entry(1, 1, "touch", robot, "brick", target=contact),
        entry(1, 2, "stable", robot, "brick"),
        entry(2, 2, "pose_eq", "brick", target=goal),
    ]


def test_a_box_is_picked_and_placed_behind_a_wall(tmp_path):
    goal = pose((0.5, 0.15, 0.04))
    world = scene(tmp_path, [("wall", (0.3, 0.02, 0.15), (0.5, 0, 0.075))], [("brick", BRICK, (0.5, -0.15, 0.04))])
    problem = SkeletonProblem(Skeleton(pick_and_place("arm", goal, grasp())), Workspace(world), (20, 30))
    path = solved(problem)
    poses = problem.object_poses(path)["brick"]
    np.testing.assert_array_equal(poses[:20], np.tile(world.bodies["brick"].pose, (20, 1)))
    assert max(distance(poses[-1], goal)) < 2e-4
    assert (np.einsum("ij,ij->i", poses[1:, 3:], poses[:-1, 3:]) > 0).all()
    hand = multiply(world.bodies["brick"].pose, grasp().T_obj_ee)
    assert max(distance(problem.workspace.end_effectors("arm", path)[19], hand)) < 2e-4
    found, who = depth(problem, path, {"arm": [OPEN, BRICK[1]]})
    assert found < PENETRATION, who


def test_a_box_is_pushed_on_its_table(tmp_path):
    size, start = (0.1, 0.1, 0.16), (0.5, 0.1, 0.08)
    world = scene(tmp_path, [], [("brick", size, start)])
    touching = contact(ContactKind.PUSH, (1, 0, 0), (0, 1, 0), (-0.05 - TIP, 0, 0.02), 0.0)
    goal = pose((0.62, 0.05, 0.08))
    entries = [*pick_and_place("arm", goal, touching), entry(1, 2, "above", "brick", "table")]
    problem = SkeletonProblem(Skeleton(entries), Workspace(world), 10)
    path = solved(problem)
    poses = problem.object_poses(path)["brick"]
    assert np.abs(poses[:, 2] - 0.08).max() < 2e-4 and np.abs(poses[:, 3:5]).max() < 2e-4
    assert max(distance(poses[-1], goal)) < 2e-4
    found, who = depth(problem, path, {"arm": [0.0, 0.0]})
    assert found < PENETRATION, who


def test_two_arms_reach_past_each_other(tmp_path):
    world = scene(tmp_path, [], [("brick", BRICK, (0.45, 0.6, 0.04))], TWO_ARMS)
    targets = {"left": from_rpy((0.55, 0.15, 0.3), (np.pi, 0, 0)), "right": from_rpy((0.35, -0.15, 0.3), (np.pi, 0, 3))}
    skeleton = Skeleton([entry(1, 1, "pose_eq", name, target=T) for name, T in targets.items()])
    problem = SkeletonProblem(skeleton, Workspace(world), 20)
    path = solved(problem)
    assert path.shape == (20, 14)
    for name, T in targets.items():
        assert max(distance(problem.workspace.end_effectors(name, path)[-1], T)) < 2e-4
    found, who = depth(problem, path, {})
    assert found < PENETRATION, who


def test_a_box_is_handed_over(tmp_path):
    long = (0.3, 0.05, 0.05)
    world = scene(tmp_path, [], [("brick", long, (0.4, -0.2, 0.025))], TWO_ARMS)
    first = contact(ContactKind.GRASP, DOWN, (0, -1, 0), (-0.1, 0, 0.01), 0.05)
    second = contact(ContactKind.GRASP, DOWN, (0, 1, 0), (0.1, 0, 0.01), 0.05)
    goal = pose((0.5, 0.25, 0.025))
    skeleton = Skeleton([
        entry(1, 2, "stable", "left", "brick", target=first),
        entry(2, 3, "stable", "right", "brick", target=second),
        entry(3, 3, "pose_eq", "brick", target=goal),
    ])  # fmt: skip
    assert skeleton.switches() == [ModeSwitch(1, "brick", None, "left"), ModeSwitch(2, "brick", "left", "right")]
    problem = SkeletonProblem(skeleton, Workspace(world), 15)
    path = solved(problem)
    poses = problem.object_poses(path)["brick"]
    assert max(distance(poses[-1], goal)) < 2e-4
    hands = {name: problem.workspace.end_effectors(name, path) for name in ("left", "right")}
    assert max(distance(multiply(inverse(poses[29]), hands["left"][29]), first.T_obj_ee)) < 2e-4
    assert max(distance(multiply(inverse(poses[29]), hands["right"][29]), second.T_obj_ee)) < 2e-4
    found, who = depth(problem, path, {"left": [OPEN, 0.05, OPEN], "right": [OPEN, OPEN, 0.05]})
    assert found < PENETRATION, who


def test_a_stick_in_the_hand_pushes_a_box(tmp_path):
    stick, box = (0.04, 0.35, 0.04), (0.1, 0.1, 0.1)
    world = scene(tmp_path, [], [("box", box, (0.55, 0.3, 0.05))], tools=[("stick", stick, (0.45, -0.15, 0.02))])
    held = contact(ContactKind.GRASP, DOWN, (1, 0, 0), (0, -0.1, 0.01), 0.04)
    T_box_stick = pose((0.0, -0.05 - 0.175, -0.02))  # its end at the middle of the side
    goal = pose((0.55, 0.38, 0.05))
    skeleton = Skeleton([
        entry(1, 3, "stable", "arm", "stick", target=held),
        entry(2, 2, "touch", "stick", "box", target=T_box_stick),
        entry(2, 3, "stable", "stick", "box"),
        entry(2, 3, "above", "box", "table"),
        entry(3, 3, "pose_eq", "box", target=goal),
    ])  # fmt: skip
    problem = SkeletonProblem(skeleton, Workspace(world), (15, 15, 10))
    path = solved(problem)
    poses = problem.object_poses(path)
    assert max(distance(poses["box"][-1], goal)) < 2e-4
    assert max(distance(multiply(inverse(poses["box"][-1]), poses["stick"][-1]), T_box_stick)) < 2e-4
    found, who = depth(problem, path, {"arm": [0.056, 0.04, 0.04]})
    assert found < PENETRATION, who
