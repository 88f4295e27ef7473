"""Skeletons: from who touches and holds what, to paths that the judge's geometry finds free."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skeleton_fixtures import TIP, TWO_ARMS, contact, depth, scene

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.exceptions import InputError
from hmap_core.komo.clearances import Clearances
from hmap_core.komo.min_distances import (
    HELD_CLEARANCE,
    OBJECT_CLEARANCE,
    ROBOT_CLEARANCE,
    SELF_CLEARANCE,
    TOUCH_ALLOWANCE,
)
from hmap_core.komo.segment import free_opening
from hmap_core.komo.skeleton import TO_THE_END, ModeSwitch, Skeleton, SkeletonEntry
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


def test_boxes_are_placed_one_after_the_other(tmp_path):
    """The second stands on the first."""
    world = scene(tmp_path, [], [("brick", BRICK, (0.5, -0.15, 0.04)), ("block", BRICK, (0.4, 0.15, 0.04))])
    goals = {"brick": pose((0.55, 0.15, 0.04)), "block": pose((0.55, 0.15, 0.12))}
    skeleton = None
    for name, goal in goals.items():
        part = Skeleton([
            entry(1, 2, "stable", "arm", name, target=grasp()),
            entry(1.8, 1.8, "position_eq", name, target=goal[:3] + (0, 0, 0.04)),
            entry(2, 2, "pose_eq", name, target=goal),
        ])  # fmt: skip
        skeleton = skeleton.then(part) if skeleton else part
    assert [(s.phase, s.object, s.after) for s in skeleton.switches()] == [
        (1, "brick", "arm"), (2, "brick", None), (3, "block", "arm"),
    ]  # fmt: skip
    problem = SkeletonProblem(skeleton, Workspace(world), (10, 15, 10, 20))
    path = solved(problem)
    poses = problem.object_poses(path)
    for name, goal in goals.items():
        assert max(distance(poses[name][-1], goal)) < 2e-4
    np.testing.assert_allclose(poses["block"][problem.step(3.8), :3], goals["block"][:3] + (0, 0, 0.04), atol=2e-4)
    found, who = depth(problem, path, {"arm": [OPEN, 0.05, OPEN, 0.05]})
    assert found < PENETRATION, who


def test_a_box_follows_a_path(tmp_path):
    world = scene(tmp_path, [], [("brick", BRICK, (0.5, -0.15, 0.04))])
    s = np.linspace(0, 1, 13)[1:]
    angle = 0.8 * s
    way = np.array([from_rpy((0.5, -0.15 + 0.2 * x, 0.04 + 0.1 * x), (0, 0, a)) for x, a in zip(s, angle, strict=True)])
    entries = [entry(1, 2, "stable", "arm", "brick", target=grasp()), entry(1, 2, "pose_eq", "brick", target=way)]
    problem = SkeletonProblem(Skeleton(entries), Workspace(world), (10, 12))
    poses = problem.object_poses(solved(problem))["brick"][10:]
    assert max(max(distance(a, b)) for a, b in zip(poses, way, strict=True)) < 3e-4


def test_one_hand_is_asked_to_be_where_the_other_is(tmp_path):
    world = scene(tmp_path, [], [("brick", BRICK, (0.45, 0.6, 0.04))], TWO_ARMS)
    beside = np.array([0.0, 0.0, -0.3])
    problem = SkeletonProblem(
        Skeleton([entry(1, 1, "position_eq", "left", "right", target=beside)]), Workspace(world), 8
    )
    path = solved(problem)
    left, right = (problem.workspace.end_effectors(name, path)[-1] for name in ("left", "right"))
    np.testing.assert_allclose(multiply(inverse(right), left)[:3], beside, atol=3e-4)


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


def test_an_attached_stick_pushes_a_box(tmp_path):
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


def test_the_example_of_the_documents():
    text = (Path(__file__).parents[4] / "docs" / "komo.md").read_text()
    example: dict = {}
    exec(text.split("## Skeletons")[1].split("```python")[1].split("```")[0], example)
    assert example["result"].feasible, example["result"].worst
    assert max(distance(example["bar"][39], example["goal"])) < 2e-4
    np.testing.assert_allclose(example["bar"][:, 2], example["goal"][2], atol=2e-4)
    found, who = depth(example["problem"], example["result"].path, {"panda_1": [0.076, 0.06, 0.076]})
    assert found < PENETRATION, who


# --- the text


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    bodies = [("brick", BRICK, (0.5, -0.15, 0.04)), ("block", BRICK, (0.5, 0.3, 0.04))]
    return Workspace(scene(tmp_path_factory.mktemp("scene"), [], bodies, TWO_ARMS), robots=["left"])


HOLD = entry(1, 2, "stable", "left", "brick", target=grasp())
GOAL = pose((0.5, 0.15, 0.04))
WRONG = {
    "no such symbol": lambda: [entry(1, 1, "grab", "left", "brick")],
    "needs 2 frames": lambda: [entry(1, 1, "touch", "left")],
    "needs 1 to 2 different frames": lambda: [entry(1, 1, "pose_eq", "brick", "brick", target=GOAL)],
    "phases must rise": lambda: [entry(2, 1, "home", "left")],
    "the start is given": lambda: [entry(0, 0, "home", "left")],
    "for whole phases": lambda: [entry(0.5, 2, "stable", "left", "brick", target=grasp())],
    "7 finite numbers": lambda: [entry(1, 1, "pose_eq", "left", target=(0.5, 0, 0.3))],
    "must be 7 finite numbers": lambda: [entry(1, 2, "stable", "left", "brick", target=(0, 0, 0.1))],
    "one contact": lambda: [entry(1, 1, "touch", "left", "brick", target=np.tile(GOAL, (3, 1)))],
    "quaternion": lambda: [entry(1, 1, "pose_eq", "left", target=(0.5, 0, 0.3, 0, 0, 0, 2))],
    "at the same time": lambda: [HOLD, entry(1, 3, "stable", "right", "brick", target=grasp())],
    "no frame 'brack'": lambda: [entry(1, 2, "stable", "left", "brack", target=grasp())],
    "no body that can be moved": lambda: [entry(1, 2, "stable", "left", "table", target=grasp())],
    "fixed and no manipulator": lambda: [entry(1, 2, "stable", "table", "brick", target=grasp())],
    "no contact is given": lambda: [entry(1, 2, "stable", "left", "brick")],
    "no pose_eq says where 'brick' is at phase 2": lambda: [HOLD, entry(3, 3, "home", "left")],
    "nothing holds it then": lambda: [entry(1, 1, "pose_eq", "brick", target=GOAL), HOLD],
    "nothing holds 'block' in phase 2": lambda: [entry(1, 2, "stable", "block", "brick", target=GOAL)],
    "nothing moves 'right' against 'brick'": lambda: [entry(1, 1, "touch", "right", "brick", target=grasp())],
    "nothing moves 'left' against 'brick'": lambda: [HOLD, entry(2, 3, "stable", "left", "brick", target=grasp(0.03))],
    "has 3 targets for 4 steps": lambda: [HOLD, entry(1, 2, "pose_eq", "brick", target=np.tile(GOAL, (3, 1)))],
    "no robot that moves": lambda: [entry(1, 1, "home", "right")],
    "must be 7 joints": lambda: [entry(1, 1, "home", "left", target=np.zeros(3))],
    "needs two bodies": lambda: [entry(1, 1, "above", "left", "table")],
    "a skeleton needs entries": lambda: [],
}


@pytest.mark.parametrize("reason", WRONG)
def test_what_does_not_fit_is_named(workspace, reason):
    with pytest.raises(InputError, match=reason):
        SkeletonProblem(Skeleton(WRONG[reason]()), workspace, 4)


def test_robots_that_move_must_be_there(workspace):
    with pytest.raises(InputError, match="no robot 'middle'; there are left, right"):
        Workspace(workspace.scene, robots=["middle"])


def test_what_is_put_onto_something_is_where_that_is(workspace):
    """Relative to a body that stands; the two may touch; a hold may be written in two."""
    on_top = pose((0, 0, BRICK[2]))
    skeleton = Skeleton([
        entry(1, 2, "stable", "left", "brick", target=grasp()),
        entry(2, 3, "stable", "left", "brick", target=grasp()),
        entry(1, 3, "above", "brick", "block"),
        entry(3, 3, "pose_eq", "brick", "block", target=on_top),
        entry(3, 4, "stable", "left", "block", target=grasp(0.0)),
    ])  # fmt: skip
    problem = SkeletonProblem(skeleton, workspace, 4)
    poses = problem.object_poses(np.tile(workspace.start, (16, 1)))
    np.testing.assert_allclose(poses["brick"][-1], multiply(workspace.state.poses["block"], on_top), atol=1e-12)
    assert min_distances(problem, "brick", "block") == {
        1: [-TOUCH_ALLOWANCE], 2: [-TOUCH_ALLOWANCE], 3: [-TOUCH_ALLOWANCE],
    }  # fmt: skip
    meetings = [list(o.steps) for o in problem.objectives if o.feature.name == "relative_pose"]
    assert sorted(meetings) == [[3], [11], [11]]
    assert "'stable left block' (phases 3 to 4)" in repr(skeleton)


def test_what_hangs_on_itself_is_bad_input(workspace):
    circle = [
        entry(1, 2, "stable", "block", "brick", target=GOAL),
        entry(1, 2, "stable", "brick", "block", target=GOAL),
    ]
    with pytest.raises(InputError, match="hangs on itself"):
        SkeletonProblem(Skeleton(circle), workspace, 4)


def test_steps_must_fit_the_phases(workspace):
    with pytest.raises(InputError, match="2 phases"):
        SkeletonProblem(Skeleton([HOLD]), workspace, (4, 4, 4))
    with pytest.raises(InputError, match="must be"):
        SkeletonProblem(Skeleton([HOLD]), workspace, 4).object_poses(np.zeros((8, 6)))


def test_phases_become_steps(workspace):
    problem = SkeletonProblem(Skeleton([HOLD, entry(1.5, TO_THE_END, "above", "brick", "table")]), workspace, (4, 6))
    assert [problem.step(p) for p in (0, 0.5, 1, 1.5, 2)] == [-1, 1, 3, 6, 9]
    found = {o.feature.name: list(o.steps) for o in problem.objectives}
    assert found == {
        "relative_pose": [3], "above: standing": [6, 7, 8, 9], "above: within": [6, 7, 8, 9],
    }  # fmt: skip


def test_an_object_attached_from_the_start_needs_no_contact(workspace):
    state = workspace.scene.start_state()
    T_world_ee = workspace.T_world_ee("left")
    state.poses["brick"] = multiply(T_world_ee, inverse(grasp().T_obj_ee))
    state.gripper["left"] = BRICK[1]
    held = Workspace(workspace.scene, state, ["left"])
    skeleton = Skeleton([entry(0, 1, "stable", "left", "brick"), entry(1, 1, "pose_eq", "brick", target=GOAL)])
    assert skeleton.switches() == [ModeSwitch(0, "brick", None, "left")]
    problem = SkeletonProblem(skeleton, held, 12)
    poses = problem.object_poses(solved(problem))["brick"]
    assert max(distance(poses[-1], GOAL)) < 2e-4


# --- who keeps apart


def min_distances(problem, a: str, b: str) -> dict[int, list[float]]:
    """Phase -> minimum distances (m) of the pairs of two parts, given by how their names begin."""
    found = {}
    model = problem.collisions
    for i, j, min_distance, phases in model.pairs:
        names = model.names[i], model.names[j]
        if any(x.startswith(a) and y.startswith(b) for x, y in (names, names[::-1])):
            for k in range(len(problem.steps_per_phase)):
                if phases >> k & 1:
                    found.setdefault(k, set()).add(round(min_distance, 6))
    return {k: sorted(v) for k, v in found.items()}


def test_clearances_follow_from_the_modes(workspace):
    entries = [*pick_and_place("left", GOAL, grasp()), entry(3, 3, "home", "left")]
    problem = SkeletonProblem(Skeleton(entries), workspace, 4)
    assert min_distances(problem, "left/panda_link5", "table") == {k: [ROBOT_CLEARANCE] for k in range(3)}
    assert min_distances(problem, "left/panda_link5", "right/panda_link5") == {k: [ROBOT_CLEARANCE] for k in range(3)}
    assert min_distances(problem, "left/panda_link5", "left/panda_link0") == {k: [SELF_CLEARANCE] for k in range(3)}
    assert min_distances(problem, "left/panda_link4", "brick") == {k: [OBJECT_CLEARANCE] for k in range(3)}
    assert min_distances(problem, "left/panda_leftfinger", "brick") == {0: [OBJECT_CLEARANCE], 2: [OBJECT_CLEARANCE]}
    # it stands on the table where it is taken and where it is put; the block is far from both
    assert min_distances(problem, "brick", "table") == {1: [-TOUCH_ALLOWANCE]}
    assert min_distances(problem, "brick", "block") == {1: [HELD_CLEARANCE]}
    assert min_distances(problem, "brick", "right") == {1: [HELD_CLEARANCE]}


def test_a_touching_hand_may_be_as_near_as_its_contact(workspace):
    pressed = contact(ContactKind.TOUCH, DOWN, (0, -1, 0), (0, 0, 0.04 + TIP), 0.0)
    problem = SkeletonProblem(Skeleton(pick_and_place("left", GOAL, pressed)), workspace, 4)
    ((min_distance,),) = min_distances(problem, "left/panda_leftfinger", "brick").values()
    assert -TOUCH_ALLOWANCE <= min_distance < 0.0
    assert min_distances(problem, "left/panda_hand", "brick") == {0: [OBJECT_CLEARANCE]}


def test_a_tool_may_touch_what_it_pushes(tmp_path):
    bodies = [("box", (0.1, 0.1, 0.1), (0.55, 0.3, 0.05))]
    world = scene(tmp_path, [], bodies, tools=[("stick", (0.04, 0.35, 0.04), (0.45, -0.15, 0.02))])
    held = contact(ContactKind.GRASP, DOWN, (1, 0, 0), (0, -0.1, 0.01), 0.04)
    entries = [
        entry(1, 3, "stable", "arm", "stick", target=held),
        entry(2, 3, "stable", "stick", "box", target=pose((0.0, -0.225, -0.02))),
    ]
    problem = SkeletonProblem(Skeleton(entries), Workspace(world), 4)
    # apart where they meet; then rigid, as both hang on the hand
    assert min_distances(problem, "stick", "box") == {1: [-TOUCH_ALLOWANCE]}
    assert min_distances(problem, "arm/panda_hand", "box") == {0: [OBJECT_CLEARANCE], 1: [OBJECT_CLEARANCE]}
    poses = problem.object_poses(np.tile(problem.workspace.start, (12, 1)))
    assert max(distance(multiply(inverse(poses["box"][-1]), poses["stick"][-1]), pose((0.0, -0.225, -0.02)))) < 1e-9


def test_shapes_may_be_replaced(workspace):
    whole = workspace.shapes["brick"]
    small = replace(whole, vertices=0.5 * whole.vertices, center=0.5 * whole.center, bound=0.5 * whole.bound)
    other = Workspace(workspace.scene, robots=["left"], shapes={"brick": small})
    skeleton = Skeleton(pick_and_place("left", GOAL, grasp()))
    # half as large it has no support where it is picked
    assert min_distances(SkeletonProblem(skeleton, other, 4), "brick", "table") == {1: [HELD_CLEARANCE]}


def test_fingers_are_open_before_a_grasp_and_after_it(workspace):
    entries = [*pick_and_place("left", GOAL, grasp()), entry(3, 3, "home", "left")]
    problem = SkeletonProblem(Skeleton(entries), workspace, 4)
    free = free_opening(workspace.scene.robots["left"], grasp())
    ((_, variants),) = Clearances(problem.timeline).openings
    assert dict(variants) == {free: 0b101, BRICK[1]: 0b010}


def test_grown_models_pack_as_others_do(workspace):
    problem = SkeletonProblem(Skeleton(pick_and_place("left", GOAL, grasp())), workspace, 4)
    grown = problem.collisions
    whole = CollisionModel(grown.hulls, grown.frames, grown.names, grown.pairs, grown.speeds).arrays()
    for name, a, b in zip(whole._fields, whole, grown.arrays(), strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
        assert a.dtype == b.dtype, name
    assert "left/panda_link0" in problem.collisions.pair_name(0)
