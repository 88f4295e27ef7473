"""An object as a variable: its path alone, and with a hand whose contact the optimiser chooses."""

import numpy as np
import pytest
from core_fixtures import arm, no_collisions
from komo_fixtures import evaluate, frame_pose

from hmap_core.collision.convex import convex_set, set_distance, transformed
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics import FreeBody, Freedom, KinematicModel, PlacedArm, extent_of
from hmap_core.komo import features
from hmap_core.komo.objective import ObjectiveType
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import distance, from_rpy, inverse, multiply, pose
from hmap_core.types import Shape, ShapeKind

HALF = 0.04  # m: half the side of the cube
STEPS = 8  # of a phase
MIN_DISTANCE = 0.01  # m
CUBE = convex_set([Shape(ShapeKind.BOX, (2 * HALF,) * 3)])


def cube(freedom: Freedom) -> FreeBody:
    size = np.ones(2 if freedom == Freedom.PLANAR else 3)
    return FreeBody("cube", freedom, pose((0.0, 0.0, HALF)), -size, size, extent_of(CUBE))


def test_an_object_finds_its_way_round_a_wall():
    """Its path alone, as in eq. (1); the straight one goes through the wall."""
    body = cube(Freedom.PLANAR)
    world = KinematicModel([body])
    wall = convex_set([Shape(ShapeKind.BOX, (0.05, 0.2, 0.2), pose((0.5, 0.02, 0.1)))])
    scene = CollisionModel()
    moving = scene.add_set("cube", CUBE, world.tip("cube"))
    scene.keep_apart(moving, scene.add_set("wall", wall, 0), MIN_DISTANCE)
    problem = KomoProblem(world.chain, (2 * STEPS,), scene)
    start, goal = (body.coordinates(from_rpy((x, 0.0, HALF), (0, 0, yaw))) for x, yaw in ((0.3, 0.0), (0.7, 0.8)))
    problem.add_objective(features.joint_position(goal), ObjectiveType.EQ, (1.0,))
    result = problem.solve(start, restarts=5)
    assert result.feasible, result.worst
    assert np.abs(result.path[-1] - goal).max() < 1e-3
    for q in result.path:
        assert set_distance(CUBE, body.pose(q), wall, pose()) >= MIN_DISTANCE - 1e-3


@pytest.mark.parametrize("freedom", Freedom)
@pytest.mark.parametrize("name", ["panda", "iiwa"])
def test_a_contact_that_the_optimiser_chooses(name, freedom):
    """The cube rests until the hand touches it anywhere, and then goes with it: touch and stable of the paper."""
    placed, body = PlacedArm("arm", arm(name), pose()), cube(freedom)
    world = KinematicModel([placed, body])
    hand, tip, first = world.tip("arm"), world.tip("cube"), world.joints("cube").start
    finger = convex_set([Shape(ShapeKind.SPHERE, (0.01,), world.T_tip_ee("arm"))])
    start, goal = (from_rpy((0.5, y, HALF), (0.0, 0.0, yaw)) for y, yaw in ((0.0, 0.3), (0.2, 0.8)))
    problem = KomoProblem(world.chain, (STEPS, STEPS), no_collisions())
    add, EQ = problem.add_objective, ObjectiveType.EQ
    add(features.joint_position(np.zeros(body.n), first), EQ, (0.0, 1.0), order=1)
    add(features.distance(hand, finger, tip, CUBE), EQ, (1.0,))
    add(features.stable(tip, hand), EQ, (1.0, 2.0), order=1)
    add(features.joint_position(body.coordinates(goal), first), EQ, (2.0,))
    q = np.r_[placed.arm.model.home, body.coordinates(start)]
    result = problem.solve(q, np.tile(q, (2 * STEPS, 1)))
    assert result.feasible, result.worst
    drift = STEPS * problem.options.tolerance  # the tolerance is that of one step
    poses = [body.pose(q[world.joints("cube")]) for q in result.path]
    assert all(max(distance(T, start)) < 2 * drift for T in poses[:STEPS])
    assert max(distance(poses[-1], goal)) < 2 * problem.options.tolerance
    touch = evaluate(problem.objectives[1].feature, world.chain, result.path[STEPS - 1])[0]
    assert abs(touch[0]) <= problem.options.tolerance
    held = [
        multiply(inverse(frame_pose(world.chain, q, hand)), T)
        for q, T in zip(result.path[STEPS - 1 :], poses[STEPS - 1 :], strict=True)
    ]
    assert max(max(distance(T, held[0])) for T in held) < 3 * drift
    assert max(distance(poses[-1], poses[0])) > 0.15  # and it went somewhere


def test_what_the_object_does_alone_does_not_move_the_arm():
    placed, body = PlacedArm("arm", arm("panda"), pose()), cube(Freedom.SPATIAL)
    world = KinematicModel([placed, body])
    q = np.r_[placed.arm.model.home, np.zeros(6)]
    goal = np.r_[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    problem = KomoProblem(world.chain, (STEPS,), no_collisions())
    problem.add_objective(features.joint_position(goal, 7), ObjectiveType.EQ, (1.0,))
    result = problem.solve(q)
    assert result.feasible, result.worst
    np.testing.assert_allclose(result.path[:, :7], np.tile(q[:7], (STEPS, 1)), atol=1e-9)
    moved = transformed(CUBE, body.pose(result.path[-1][7:]))
    np.testing.assert_allclose(moved.vertices, transformed(CUBE, body.pose(goal)).vertices, atol=1e-3)
