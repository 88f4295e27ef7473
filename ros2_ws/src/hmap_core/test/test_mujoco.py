"""The second physics engine: the exported scene, its robots and contacts, and executions in it."""

import sys
from dataclasses import replace

import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.scenes import list_tasks, load_robot_model, load_scene
from hmap_core.simulation import engines
from hmap_core.simulation.bodies import mass_properties
from hmap_core.simulation.engines import MUJOCO, check_engine, open_world
from hmap_core.simulation.execute import execute_closed_loop
from hmap_core.simulation.mjcf import scene_to_mjcf
from hmap_core.types import BodyKind, Goal, Robot, SegmentKind, Shape, ShapeKind

mujoco_world = pytest.importorskip("hmap_core.simulation.mujoco_world")
MujocoWorld = mujoco_world.MujocoWorld


def stepped(world, seconds: float):
    while world.time < seconds:
        world.step()
    return world


@pytest.fixture(scope="module")
def drag():
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    scene = sim.scene(box, goal=Goal("box", transforms.pose((0.5, 0.2, 0.03))))
    return plan_fixtures.drag_plan(scene, "box", 0.06, np.array([0.0, 0.3, 0.0]), lift=0.1)


@pytest.mark.parametrize("task", list_tasks())
def test_every_task_rests_as_it_is_described(task):
    scene = load_scene(task, seed=1)
    world = MujocoWorld(scene)
    start = {name: world.body_pose(name) for name in world.body_names()}
    assert start.keys() == scene.bodies.keys()
    stepped(world, 0.3)
    for name, pose in start.items():
        np.testing.assert_allclose(pose, scene.bodies[name].pose, atol=1e-8)
        position, rotation = transforms.distance(world.body_pose(name), pose)
        assert position < 2e-3 and rotation < np.deg2rad(1.0), name
    for name, robot in scene.robots.items():
        np.testing.assert_allclose(world.robot(name).arm_state()[0], robot.q, atol=2e-3)


@pytest.mark.parametrize("name", ["panda", "ur5e_2f85", "xarm7", "iiwa14_wsg50", "gen3_2f85", "fr3"])
def test_grippers_open_and_close_as_their_files_say(name):
    model = load_robot_model(name)
    scene = replace(sim.scene(), robots={"arm": Robot("arm", model, transforms.pose((0.0, 0.0, 1.0)), model.home)})
    world = MujocoWorld(scene)
    gripper = model.require_gripper()
    wanted = 0.5 * (gripper.min_opening + gripper.open_opening)
    world.robot("arm").set_gripper(wanted, gripper.force)
    stepped(world, 1.0)
    assert world.robot("arm").gripper_state()[0] == pytest.approx(wanted, abs=1e-3)
    np.testing.assert_allclose(world.robot("arm").arm_state()[0], model.home, atol=5e-3)


def test_a_body_slides_on_a_slope_that_friction_does_not_hold():
    angle = np.deg2rad(20.0)
    tilt = (0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2))
    slope = replace(
        sim.box("slope", (1.0, 1.0, 0.1), (0, 0, 0), BodyKind.FIXED, friction=1.0),
        pose=transforms.pose((0, 0, 1), tilt),
    )
    moved = []
    for friction in (0.3, 0.45):  # the tangent of 20 degrees is 0.36; the product of the coefficients counts
        up = transforms.multiply(slope.pose, transforms.pose((0.0, 0.0, 0.08)))
        box = replace(sim.box("box", (0.06, 0.06, 0.06), (0, 0, 0), friction=friction), pose=up)
        world = stepped(MujocoWorld(sim.scene(slope, box, robots=False)), 0.5)
        moved.append(transforms.distance(world.body_pose("box"), up)[0])
    expected = 0.5 * 9.81 * (np.sin(angle) - 0.3 * np.cos(angle)) * 0.5**2
    assert moved[0] == pytest.approx(expected, rel=0.1) and moved[1] < 1e-3


def test_mass_properties_are_those_of_the_shapes():
    shapes = (
        Shape(ShapeKind.CYLINDER, (0.02, 0.2), transforms.pose((0.0, 0.0, 0.1))),
        Shape(ShapeKind.BOX, (0.1, 0.05, 0.02)),
    )
    body = replace(sim.box("body", (1, 1, 1), (0.3, 0.2, 0.5), mass=0.7), shapes=shapes)
    world = MujocoWorld(sim.scene(body, robots=False))
    link = world.model.body("body")
    T, moments = mass_properties(shapes, 0.7)
    assert link.mass[0] == pytest.approx(0.7)
    np.testing.assert_allclose(link.ipos, T[:3], atol=1e-9)
    np.testing.assert_allclose(np.sort(link.inertia), np.sort(moments), rtol=1e-6)


def test_contacts_tell_body_link_and_force():
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03), mass=0.5)
    world = stepped(MujocoWorld(sim.scene(box)), 0.5)
    contacts = world.contacts("box")
    assert {(c.a, c.b, c.link_b) for c in contacts} == {("box", "table", "")}
    assert sum(c.force for c in contacts) == pytest.approx(0.5 * 9.81, rel=0.02)
    assert all(c.normal[2] > 0.99 for c in contacts)  # from the table towards the box


def test_a_plan_is_executed_as_in_the_other_engine(drag):
    report = execute_closed_loop(drag, None, 0, engine=MUJOCO)
    assert report.solved
    assert report.goal_error.position_m < 0.003


def test_a_press_is_refused(drag):
    press = replace(drag.segments[1], kind=SegmentKind.PRESS)
    plan = replace(drag, segments=(drag.segments[0], press, drag.segments[2]))
    with pytest.raises(InputError, match="presses on 'box' at .* use engine 'pybullet'"):
        execute_closed_loop(plan, None, 0, engine=MUJOCO)


def test_the_same_plan_gives_the_same_report(drag):
    first, second = (execute_closed_loop(drag, None, 0, engine=MUJOCO).last for _ in range(2))
    assert first.goal_error == second.goal_error


def test_the_model_is_one_text(drag, tmp_path):
    import mujoco

    text = scene_to_mjcf(drag.scene, tmp_path)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.nu == 9 and {model.joint(i).name for i in range(model.njnt)} >= {"box", "left/panda_joint1"}
    assert str(tmp_path) not in text


def test_what_cannot_be_exported_is_named(tmp_path):
    with pytest.raises(InputError, match="body 'box' .* mass 0 kg"):
        scene_to_mjcf(sim.scene(sim.box("box", (0.1, 0.1, 0.1), (0, 0, 0.05), mass=0)), tmp_path)


def test_an_unknown_engine_is_named():
    with pytest.raises(InputError, match="'bulet' is not known; there are pybullet, mujoco"):
        open_world(sim.scene(), "bulet")


def test_without_the_package_the_engine_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "hmap_core.simulation.mujoco_world")
    monkeypatch.delattr(engines.__package__ + ".mujoco_world", raising=False)
    with pytest.raises(InputError, match="needs the package mujoco.*pip install 'hmap_core\\[mujoco\\]'"):
        check_engine(MUJOCO)
