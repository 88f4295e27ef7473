"""How fast a body may be moved, by its weight, its friction and where it is grasped."""

from dataclasses import replace

import numpy as np
import pytest

from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.contacts.grip_force import LIFT_ACCELERATION
from hmap_core.planner.segments import carried
from hmap_core.planner.segments.attached import end_effector_poses
from hmap_core.scenes import load_scene
from hmap_core.transforms import multiply, pose
from hmap_core.types import Body, BodyKind, Scene, Shape, ShapeKind, TaskMode

CUBE = (Shape(ShapeKind.BOX, (0.04, 0.04, 0.04)),)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("bolt")


def grasped(scene: Scene, mass: float, friction: float = 0.8, away: float = 0.0):
    robot = next(iter(scene.robots))
    body = Body("cube", BodyKind.MOVABLE, CUBE, pose(), mass, friction)
    return carried.grasped(scene, robot, body, pose((away, 0.0, 0.0)), 0.04)


def test_heavier_and_smoother_bodies_are_accelerated_less(scene):
    light, heavy = grasped(scene, 0.1), grasped(scene, 4.3)
    assert light.acceleration == carried.LARGEST
    assert LIFT_ACCELERATION <= heavy.acceleration < carried.LARGEST
    assert grasped(scene, 0.6, 0.05).acceleration < grasped(scene, 0.6, 0.8).acceleration


def test_a_body_grasped_off_its_centre_is_accelerated_less(scene):
    assert grasped(scene, 0.5, away=0.08).acceleration < grasped(scene, 0.5).acceleration


def test_the_pads_hold_weight_and_acceleration(scene):
    gripper = next(iter(scene.robots.values())).model.require_gripper()
    for mass in (0.5, 1.0, 2.4, 4.2):
        limit = grasped(scene, mass, 0.6)
        if limit.acceleration > LIFT_ACCELERATION:
            assert mass * (GRAVITY + limit.acceleration) <= min(1.2, 1.0) * gripper.force


def test_a_pushed_body_slows_down_by_friction_alone(scene):
    name = next(name for name, body in scene.bodies.items() if body.mass > 0.0)
    robot = next(iter(scene.robots))
    for friction in (0.1, 0.3):
        slippery = replace(scene, bodies=scene.bodies | {name: replace(scene.bodies[name], friction=friction)})
        assert carried.pushed(slippery, robot, name, pose()).acceleration <= friction * GRAVITY
    assert carried.pushed(scene, robot, name, pose()).speed < grasped(scene, 0.1).speed


def test_a_kinematic_task_has_no_weights(scene):
    assert grasped(replace(scene, mode=TaskMode.KINEMATIC), 50.0).acceleration == carried.LARGEST


def test_the_point_is_the_centre_of_mass(scene):
    robot = scene.robots[next(iter(scene.robots))]
    body = Body("cube", BodyKind.MOVABLE, CUBE, pose(), 0.1, 0.8)
    limit = carried.grasped(scene, robot.name, body, pose((0.0, 0.0, 0.05)), 0.04)
    q = np.stack([robot.q, robot.model.home])
    expected = [multiply(T, pose((0.0, 0.0, 0.05)))[:3] for T in end_effector_poses(scene, robot.name, q)]
    assert limit.position(q) == pytest.approx(np.array(expected))
