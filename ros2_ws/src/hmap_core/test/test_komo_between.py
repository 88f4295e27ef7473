"""Between the steps: what is violated there is found, and no deeper than the resolution missed."""

import numpy as np
import pytest
from core_fixtures import arm, model, no_collisions, random_pose, random_q
from test_komo_solver import BOX, with_links

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.chain import Chain
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.between import BETWEEN_TOLERANCE, new_place, violated_between
from hmap_core.komo.features import relative_pose, relative_position
from hmap_core.komo.objective import ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.result import Status
from hmap_core.komo.sweep import between_violations
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import multiply, pose

RESOLUTION = 5e-4  # m
DENSE = 400  # configurations of an interval that brute force looks at
ROUNDING = 5e-6  # m: of the distances


def dense(path, masks, chain, cols):
    """The worst violation of each interval (T,), from DENSE configurations of each; 0 where there is none."""
    line = np.linspace(0.0, 1.0, DENSE)[:, None]
    worst = []
    for before, after, mask in zip(path, path[1:], masks, strict=False):
        violation, _ = path_violations(before + line * (after - before), np.full(DENSE, mask), chain, cols, 0.0)
        worst.append(violation.max())
    return np.array(worst)


def assert_none_is_missed(path, masks, chain, cols):
    """Returns the violations of each interval."""
    violation, pair, alpha = between_violations(path, masks, chain, cols, RESOLUTION)
    assert (violation >= dense(path, masks, chain, cols) - RESOLUTION - ROUNDING).all()
    np.testing.assert_array_equal(pair >= 0, violation > 0.0)
    for t in np.flatnonzero(pair >= 0):  # and what is said to be violated is, there
        q = path[t] + alpha[t] * (path[t + 1] - path[t])
        there, _ = path_violations(q[None], masks[t : t + 1], chain, cols, 0.0)
        assert violation[t] == pytest.approx(there[0], abs=ROUNDING)
        assert cols.phases[pair[t]] & masks[t]
    return violation


@pytest.mark.parametrize("seed", range(2))
def test_arms_among_boxes_and_each_other(seed):
    """Short motions and long ones, in two phases."""
    rng = np.random.default_rng(seed)
    world = model("panda", "iiwa")
    boxes = [(rng.uniform(0.1, 0.3, 3), random_pose(rng, 0.6)) for _ in range(3)]
    scene = with_links(world, *boxes, min_distance=0.01, phases=0b01)
    links = [s for s, f in enumerate(scene.frames) if f]
    left, right = ([s for s in links if (scene.frames[s] <= 7) == side] for side in (True, False))
    scene.keep_apart(left[3:], right[3:], 0.005, 0b11)
    path = [random_q(world.chain, rng)]
    for size in np.tile([0.03, 0.2, 1.0], 6):
        path.append(path[-1] + size * (random_q(world.chain, rng) - path[-1]))
    masks = rng.integers(1, 4, len(path) - 1)
    violation = assert_none_is_missed(np.array(path), masks, world.chain, scene.arrays())
    assert 0 < (violation > 0.0).sum() < len(violation)


@pytest.mark.parametrize("mask", [0b01, 0b10], ids=["past a box", "past another arm"])
def test_stretched_arms_that_sweep_through_something_in_one_interval(mask):
    """Free at both ends, in the way in the middle."""
    bases = pose(), pose((1.8, 0, 0), (0, 0, 1, 0))  # their tips overlap when they point at each other
    world = KinematicModel([PlacedArm(name, arm("iiwa"), T) for name, T in zip("ab", bases, strict=True)])
    stretched = np.array([0, np.pi / 2, 0, 0, 0, 0, 0])
    scene = with_links(world, (0.02 * np.ones(3), world.arms["a"].arm.end_effector(stretched)), phases=0b01)
    links = [s for s, f in enumerate(scene.frames) if f]
    left, right = ([s for s in links if (scene.frames[s] <= 7) == side] for side in (True, False))
    scene.keep_apart(left[-2:], right[-2:], 0.005, 0b10)
    path = np.tile(stretched, (2, 2))
    path[:, [0, 7]] = [[-1.1, -1.1], [1.3, 1.3]]
    cols, masks = scene.arrays(), np.array([mask])
    assert (path_violations(path, np.full(2, mask), world.chain, cols, 0.0)[1] == -1).all()
    assert assert_none_is_missed(path, masks, world.chain, cols)[0] > 0.005


def slider() -> Chain:
    """A joint that slides along x by 3 m."""
    turned = np.array([[[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]])
    zero, one = np.zeros(1), np.ones(1)
    return Chain(
        np.zeros(1, np.int64), turned, np.zeros((1, 3)), np.ones(1, np.int64), np.zeros(2, np.int64), zero,
        3.0 * one, one,
    )  # fmt: skip


@pytest.mark.parametrize("inside", [-1e-5, 0.0, 3e-4], ids="{:g} m".format)
def test_a_contact_that_slides_is_as_deep_as_it_is(inside):
    """A ball along a table: at its minimum distance all the way, so that every look is as near as the last."""
    scene = CollisionModel()
    ball = scene.add("ball", np.zeros((1, 3)), 0.01, 1)
    table = scene.add("table", BOX * [4.0, 1.0, 0.1] - [0.0, 0.0, 0.06 - inside], 0.0, 0)
    scene.keep_apart([ball], [table], 0.0)
    path = np.linspace(0.0, 1.5, 4)[:, None]
    violation, _, _ = between_violations(path, np.ones(3, np.int64), slider(), scene.arrays(), RESOLUTION)
    np.testing.assert_allclose(violation, max(inside, 0.0), atol=1e-7)


@pytest.mark.parametrize("depth", [0.6e-3, 2e-3, 10e-3], ids="{:g} m".format)
def test_a_small_mark_on_a_long_way_is_not_passed_over(depth):
    """A ball that passes a mark beside its way, in one interval of 2.5 m."""
    scene = CollisionModel()
    ball = scene.add("ball", np.zeros((1, 3)), 0.005, 1)
    mark = scene.add("mark", np.array([[1.2345, 0.0, 0.01 - depth]]), 0.005, 0)
    scene.keep_apart([ball], [mark], 0.0)
    path = np.array([[0.0], [2.5]])
    violation, _, alpha = between_violations(path, np.ones(1, np.int64), slider(), scene.arrays(), RESOLUTION)
    assert depth - RESOLUTION <= violation[0] <= depth + 1e-9
    assert abs(2.5 * alpha[0] - 1.2345) < 0.01


# --- constraints between the steps


def turning_in_place(refinements: int):
    """The hand keeps its place while it turns by a radian in four steps; between them the joints cut the corner."""
    world = model("panda")
    name, placed = next(iter(world.arms.items()))
    start = placed.arm.model.home
    T = multiply(placed.T_world_base, placed.arm.end_effector(start))
    tip, T_tip_ee = world.tip(name), world.T_tip_ee(name)
    turned = multiply(T, pose(quaternion=(np.sin(0.5), 0, 0, np.cos(0.5))))
    problem = KomoProblem(world.chain, (4,), no_collisions(), SolverOptions(refinements=refinements))
    place = relative_position(tip, T_tip_ee[:3], T[:3])
    problem.add_objective(place, ObjectiveType.EQ)
    problem.add_objective(relative_pose(tip, T_tip_ee, turned), ObjectiveType.EQ, (1.0,))
    return world, problem, start, T, T_tip_ee


def test_a_constraint_that_is_left_between_the_steps_is_named():
    _, problem, start, _, _ = turning_in_place(0)
    result = problem.solve(start)
    assert (result.feasible, result.status) == (False, Status.BETWEEN_STEPS)
    assert "relative_position" in result.worst and "frames 7" in result.worst
    found = violated_between(problem, np.concatenate([start[None], result.path]), problem.arrays(), problem.terms())
    assert {violation.objective for violation in found} == {0}
    assert max(violation.amount for violation in found) == result.worst_inequality > BETWEEN_TOLERANCE[0]


def test_refinement_keeps_a_constraint_between_the_steps():
    world, problem, start, T, T_tip_ee = turning_in_place(4)
    result = problem.solve(start)
    assert result.feasible, result.worst
    path = np.concatenate([start[None], result.path])
    placed = next(iter(world.arms.values()))
    fine = [a + s * (b - a) for a, b in zip(path, path[1:], strict=False) for s in np.linspace(0, 1, 21)]
    off = [np.abs(multiply(placed.T_world_base, placed.arm.end_effector(q))[:3] - T[:3]).max() for q in fine]
    assert max(off) < 1.2 * BETWEEN_TOLERANCE[0]  # it is verified at four places of each interval
    at_steps = off[20::21]
    assert max(at_steps) <= problem.options.tolerance


@pytest.mark.parametrize(
    "known, alpha, expected",
    [
        ([], 0.3, 0.3),
        ([], 0.505, 0.25),  # the middle is known: the first of the widest gaps
        ([(2, 0.25)], 0.25, 0.75),
        ([(1, 0.25)], 0.25, 0.25),  # that was another interval
    ],
)
def test_where_to_look_closer(known, alpha, expected):
    assert new_place(2, known, 2, alpha) == (2, expected)
