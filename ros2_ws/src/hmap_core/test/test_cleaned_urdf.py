"""The URDF that is simulated says the same as the robot description, and what it leaves out is sensible."""

from dataclasses import replace

import mesh_fixtures as meshes
import numpy as np
import pytest
from robot_fixtures import BALL, COLLISION, INERTIAL, LIMIT, joint, link, robot, write, write_robot

from hmap_core.robot_description import cleaned_urdf, load_robot_description
from hmap_core.robot_description.inertia import DENSITY, FRAME_MASS
from hmap_core.scenes import load_robot_model
from hmap_core.scenes.robot_rules import simulated_urdf
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.robots import SimulatedRobot
from hmap_core.types import Robot

MIMIC = '<mimic joint="elbow" multiplier="0.5" offset="0.1"/>'
MESH = COLLISION.format('<mesh filename="{}" scale="{}"/>')


def cleaned(folder, *elements: str, **changes) -> object:
    description = load_robot_description(write(folder, robot(*elements, **changes))).require_valid()
    return load_robot_description(cleaned_urdf(description)).require_valid()


def test_it_says_the_same(tmp_path):
    meshes.save(meshes.box(), tmp_path / "box.stl")
    extra = link("hand", MESH.format("box.stl", "1 -2 1") + COLLISION.format('<capsule radius="0.1" length="0.2"/>'))
    text = robot(
        extra,
        joint("wrist", "tip", "hand", "prismatic", '<axis xyz="1 2 2"/>', extra=MIMIC),
    )
    first = load_robot_description(write(tmp_path, text))
    second = load_robot_description(cleaned_urdf(first))
    assert second.findings == () and second.root == first.root
    for name, joint_ in first.joints.items():
        other = second.joints[name]
        assert replace(joint_, T_parent_joint=None, axis=None) == replace(other, T_parent_joint=None, axis=None)
        np.testing.assert_allclose(other.T_parent_joint, joint_.T_parent_joint, atol=1e-9)
        np.testing.assert_allclose(other.axis, joint_.axis, atol=1e-9)
    mesh, capsule = second.links["hand"].shapes
    assert capsule.size == (0.1, 0.2) and mesh.size == (1.0, 1.0, 1.0) and mesh.mesh.is_absolute()
    from hmap_core.mesh_files import read_hull

    vertices = read_hull(mesh.mesh).vertices
    np.testing.assert_allclose([vertices.min(0), vertices.max(0)], [[0, -0.4, 0], [0.1, 0, 0.3]], atol=1e-6)


def test_frames_weigh_next_to_nothing_and_shapes_what_their_volume_does(tmp_path):
    frame, box = link("frame", "", mass=0), link("box", COLLISION.format('<box size="0.1 0.1 0.2"/>'), mass=0)
    description = load_robot_description(
        write(tmp_path, robot(frame, box, joint("a", "tip", "frame", "fixed"), joint("b", "frame", "box", "fixed")))
    )
    assert description.links["frame"].inertial.mass == FRAME_MASS
    assert description.links["box"].inertial.mass == pytest.approx(0.002 * DENSITY)
    (finding,) = description.findings
    assert "link 'box': has no mass; 2 kg are assumed in the simulation" in str(finding)


@pytest.mark.parametrize("inertia", ["0", "-1", "nan"])
def test_an_inertia_that_no_body_has_is_replaced(tmp_path, inertia):
    ball = f'<link name="tip">{INERTIAL.format(mass=2, i=inertia)}{BALL}</link>'
    text = robot(ball, links=("base", "upper"))
    description = load_robot_description(write(tmp_path, text))
    if inertia == "nan":
        assert 'ixx="nan": must be finite' in str(description.errors[0])
        return
    assert "has no <inertia> that a body can have" in str(description.warnings[0])
    assert np.linalg.eigvalsh(description.links["tip"].inertial.inertia).min() > 1e-4


@pytest.mark.parametrize("mass", ["-1", "nan", "heavy"])
def test_a_mass_that_is_none_is_refused(tmp_path, mass):
    text = robot(f'<link name="tip"><inertial><mass value="{mass}"/></inertial></link>', links=("base", "upper"))
    assert "link 'tip', <inertial>, <mass>" in str(load_robot_description(write(tmp_path, text)).errors[0])


ARM_LINK = COLLISION.format('<box size="0.05 0.05 0.25"/>')


def standing(tmp_path, text: str, joints="shoulder, elbow", seconds=2.0) -> float:
    """How far (rad) the arm, stretched out level, drops while it is told to stay."""
    model = load_robot_model(str(write_robot(tmp_path, text, joints)))
    client = BulletClient()
    client.setGravity(0, 0, -9.81)
    q = np.array([np.pi / 2 - 0.1, *[0.0] * (len(model.joint_names) - 1)])
    arm = SimulatedRobot(client, Robot("arm", model, np.array([0, 0, 1, 0, 0, 0, 1.0]), q))
    for _ in range(int(seconds * 240)):
        client.stepSimulation()
    return float(np.abs(arm.arm_state()[0] - q).max())


@pytest.mark.parametrize("effort", ['effort="0"', ""])
def test_an_arm_without_effort_does_not_drop(tmp_path, effort):
    limit = LIMIT.replace('effort="100"', effort)
    joints = [joint("shoulder", "base", "upper", limit=limit), joint("elbow", "upper", "tip", limit=limit)]
    assert standing(tmp_path, robot(joints=joints)) < 0.01


def test_frames_without_inertia_do_not_pull_an_arm_down(tmp_path):
    """Eight empty frames once weighed 1 kg each."""
    weak = LIMIT.replace("100", "20")
    joints = [joint("shoulder", "base", "upper", limit=weak), joint("elbow", "upper", "tip", limit=weak)]
    names = [f"frame{i}" for i in range(8)]
    frames = [f'<link name="{name}"/>' for name in names]
    mounts = [joint(f"mount_{name}", "tip", name, "fixed") for name in names]
    assert standing(tmp_path, robot(*frames, *mounts, joints=joints)) < 0.01


def test_an_arm_without_any_inertia_stands(tmp_path):
    links = [f'<link name="{name}">{ARM_LINK}</link>' for name in ("base", "upper", "tip")]
    assert standing(tmp_path, robot(*links, links=())) < 0.01


def end_effector(tmp_path, text: str, joints="shoulder, elbow"):
    """Position of the tip in the simulation and by the planner's kinematics."""
    from hmap_core.kinematics import load_arm

    model = load_robot_model(str(write_robot(tmp_path, text, joints)))
    q = np.array([0.4, -0.7])[: len(model.joint_names)]
    simulated = SimulatedRobot(BulletClient(), Robot("arm", model, np.array([0, 0, 0, 0, 0, 0, 1.0]), q))
    return simulated.end_effector_pose()[:3], load_arm(model).end_effector(q)[:3]


def test_axes_of_any_length_move_the_simulated_arm_as_planned(tmp_path):
    joints = [joint("shoulder", "base", "upper", axis='<axis xyz="0 2 0"/>'), joint("elbow", "upper", "tip")]
    np.testing.assert_allclose(*end_effector(tmp_path, robot(joints=joints)), atol=1e-6)


@pytest.mark.parametrize("kind", ["planar", "floating", "continuous", "revolute", "prismatic"])
def test_joints_that_nothing_moves_are_fixed_in_the_simulation(tmp_path, kind):
    """Below the arm, and hanging from it."""
    offset = '<inertial><origin xyz="0.3 0 0"/><mass value="3"/></inertial>'
    below = joint("below", "ground", "base", kind)
    wheel = joint("spin", "tip", "wheel", kind)
    text = robot(f'<link name="ground">{offset}</link>', link("wheel"), below, wheel)
    np.testing.assert_allclose(*end_effector(tmp_path, text), atol=1e-6)
    model = load_robot_model(str(tmp_path / "arm.yaml"))
    simulated = load_robot_description(simulated_urdf(model))
    assert [j.kind for j in simulated.joints.values()] == ["revolute", "revolute", "fixed", "fixed"]


@pytest.mark.parametrize("suffix", ["obj", "dae", "glb", "ply", "stl"])
def test_meshes_of_all_formats_are_as_large_in_the_simulation_as_planned(tmp_path, suffix):
    path = tmp_path / f"box.{suffix}"
    if suffix in ("obj", "ply"):
        meshes.with_unused_vertex(path)
    elif suffix == "dae":
        meshes.in_millimetres(path)
    else:
        meshes.save(meshes.box(), path)
    text = robot(link("hand", MESH.format(path.name, "2 2 2")), joint("mount", "tip", "hand", "fixed"))
    model = load_robot_model(str(write_robot(tmp_path, text)))
    client = BulletClient()
    body = client.loadURDF(str(simulated_urdf(model)), useFixedBase=True)
    low, high = client.getAABB(body, 2)
    np.testing.assert_allclose(np.subtract(high, low), [0.2, 0.4, 0.6], atol=0.008)  # Bullet's boxes are larger


def test_visual_meshes_are_kept_or_converted_and_missing_ones_left_out(tmp_path):
    meshes.save(meshes.box(), tmp_path / "box.glb")
    meshes.save(meshes.box(), tmp_path / "box.stl")
    visual = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    inside = "".join(visual.format(name) for name in ("box.glb", "package://box.stl", "none.stl"))
    description = load_robot_description(write(tmp_path, robot(link("a", inside), joint("j", "tip", "a", "fixed"))))
    assert description.findings == ()
    text = cleaned_urdf(description).read_text()
    assert str(tmp_path / "box.stl") in text and text.count("<visual>") == 2 and "none.stl" not in text
