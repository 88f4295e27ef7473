"""Arms of any URDF: turning and sliding joints about any axis, few and many, with shapes of every kind."""

from dataclasses import replace

import numpy as np
import pytest
from komo_fixtures import assert_derivative

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics import KinematicModel, PlacedArm
from hmap_core.kinematics.arm import build_arm
from hmap_core.komo.features import relative_pose, stable
from hmap_core.simulation.client import BulletClient
from hmap_core.transforms import apply, distance, from_rpy, multiply, pose
from hmap_core.types import RobotModel

SHAPES = (
    '<box size="0.1 0.08 0.06"/>',
    '<sphere radius="0.05"/>',
    '<cylinder radius="0.03" length="0.1"/>',
    '<capsule radius="0.03" length="0.1"/>',
)
KINDS = ("revolute", "prismatic", "continuous")


def urdf_text(joints: int, rng) -> str:
    """A chain of links, each with a shape, whose joints turn and slide about random axes; the last link is fixed."""
    text = lambda v: " ".join(f"{x:.12f}" for x in v)  # noqa: E731
    number = lambda size: text(rng.uniform(-1, 1, 3) * size)  # noqa: E731
    links, chain = [], []
    for k in range(joints + 2):
        shape = f'<origin xyz="{number(0.1)}" rpy="{number(1)}"/><geometry>{SHAPES[k % 4]}</geometry>'
        inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        links.append(f'<link name="link{k}">{inertia}<collision>{shape}</collision></link>')
    for k in range(joints + 1):
        axis = rng.normal(size=3)
        kind = KINDS[k % 3] if k < joints else "fixed"
        chain.append(
            f'<joint name="joint{k}" type="{kind}"><parent link="link{k}"/><child link="link{k + 1}"/>'
            f'<origin xyz="{number(0.3)}" rpy="{number(2)}"/><axis xyz="{text(axis / np.linalg.norm(axis))}"/>'
            '<limit lower="-1" upper="1" effort="10" velocity="1"/></joint>'
        )
    return f'<robot name="any">{"".join(links)}{"".join(chain)}</robot>'


def model_of(file, joints: int) -> RobotModel:
    one = np.ones(joints)
    return RobotModel(
        "any", file, str(file), tuple(f"joint{k}" for k in range(joints)), f"link{joints + 1}",
        from_rpy((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)), 0 * one, np.array([-one, one]), one, one, None, (),
    )  # fmt: skip


@pytest.fixture
def robot(tmp_path):
    """Of so many joints: the model of a random arm."""

    def make(joints: int) -> RobotModel:
        file = tmp_path / f"{joints}.urdf"
        file.write_text(urdf_text(joints, np.random.default_rng(joints)))
        return model_of(file, joints)

    return make


@pytest.mark.parametrize("joints", [1, 3, 8, 12])
def test_the_end_effector_is_where_pybullet_has_it(robot, joints):
    rng = np.random.default_rng(1)
    model = robot(joints)
    arm, client = build_arm(model), BulletClient()
    assert (arm.prismatic == [k % 3 == 1 for k in range(joints)]).all()
    body = client.loadURDF(str(model.urdf), useFixedBase=True)
    base = client.getDynamicsInfo(body, -1)[3:5]  # PyBullet places the base by its centre of mass
    client.resetBasePositionAndOrientation(body, *base)
    for _ in range(10):
        q = rng.uniform(*model.position_limits)
        for k, value in enumerate(q):
            client.resetJointState(body, k, value)
        state = client.getLinkState(body, joints, computeForwardKinematics=True)
        expected = multiply(pose(state[4], state[5]), model.T_link_ee)
        apart = distance(arm.end_effector(q), expected)
        assert apart[0] < 1e-5 and apart[1] < 1e-5


@pytest.mark.parametrize("joints", [3, 14])
def test_features_know_sliding_and_turning_joints(robot, joints):
    rng = np.random.default_rng(2)
    arm = build_arm(robot(joints))
    world = KinematicModel([PlacedArm("a", arm, pose()), PlacedArm("b", arm, from_rpy((1, 0, 0), (0.1, 0.2, 0.3)))])
    for _ in range(3):
        q = rng.uniform(world.chain.lower, world.chain.upper)
        assert_derivative(stable(world.tip("a"), world.tip("b"), rng.normal(size=3)), world.chain, q, 1e-7)
        target = multiply(from_rpy((0, 0, 0), (0.1, 0.1, 0.1)), pose())
        assert_derivative(relative_pose(world.tip("a") - 1, pose(), target, 1), world.chain, q, 1e-7)


@pytest.mark.parametrize("limits", [(-1.0, 1.0), (0.8, 1.0)])
@pytest.mark.parametrize("joints", [3, 14])
def test_no_point_moves_more_than_reach_says(robot, joints, limits):
    """Also with sliding joints further out, whose stroke counts."""
    rng = np.random.default_rng(3)
    arm = build_arm(replace(robot(joints), position_limits=np.outer(limits, np.ones(joints))))
    reach = arm.reach()
    assert len(arm.hulls) == joints + 2
    for _ in range(100):
        q, other = (rng.uniform(*arm.model.position_limits) for _ in range(2))
        bound = reach @ np.abs(other - q)
        (Ra, pa), (Rb, pb) = arm.frames(q), arm.frames(other)
        for hull in arm.hulls:
            f = hull.frame
            moved = hull.vertices @ (Rb[f] - Ra[f]).T + pb[f] - pa[f]
            assert np.linalg.norm(moved, axis=1).max() <= bound + 1e-12


@pytest.mark.parametrize("first", ["revolute", "prismatic"])
@pytest.mark.parametrize("limits", [(-1.0, 1.0), (0.8, 1.0)])
def test_no_point_is_farther_than_the_length_says(robot, first, limits):
    model = robot(3)
    model.urdf.write_text(model.urdf.read_text().replace('type="revolute"', f'type="{first}"', 1))
    arm = build_arm(replace(model, position_limits=np.outer(limits, np.ones(3))))
    assert arm.prismatic[0] == (first == "prismatic")
    farthest = 0.0
    for q in np.random.default_rng(4).uniform(*limits, (200, 3)):
        R, p = arm.frames(q)
        for hull in (h for h in arm.hulls if h.frame > 0):
            points = hull.vertices @ R[hull.frame].T + p[hull.frame] - arm.p_joint[0]
            farthest = max(farthest, np.linalg.norm(points, axis=1).max() + hull.radius)
    assert 0.3 * arm.length < farthest <= arm.length + 1e-12


def test_points_of_the_last_link_are_given_from_the_end_effector(robot):
    arm = build_arm(robot(3))
    vertices = np.concatenate([hull.vertices for hull in arm.hulls if hull.frame == 3])
    R, p = arm.frames(np.zeros(3))
    np.testing.assert_allclose(
        apply(arm.end_effector(np.zeros(3)), arm.tip_vertices()), vertices @ R[-1].T + p[-1], atol=1e-9
    )


@pytest.mark.parametrize(
    "changes, says",
    [
        (
            {"joint_names": ("joint0", "elbow", "joint2")},
            "joint 'elbow' is not in the URDF; it has joint0, joint1, joint2",
        ),
        ({"joint_names": ("joint1", "joint0", "joint2")}, "joint 'joint0' is number 1 .* but number 2"),
        ({"end_effector_link": "hand"}, "end_effector_link 'hand' is not in the URDF"),
        ({"end_effector_link": "link1"}, "end_effector_link 'link1' does not follow the last joint"),
    ],
)
def test_a_model_that_does_not_fit_its_urdf_is_refused(robot, changes, says):
    with pytest.raises(InputError, match=says) as error:
        build_arm(replace(robot(3), **changes))
    assert error.value.code == Code.INVALID_SCENE


def test_a_mesh_that_is_missing_is_named(tmp_path):
    file = tmp_path / "a.urdf"
    mesh = '<mesh filename="package://meshes/arm.stl"/>'
    file.write_text(f'<robot><link name="a"><collision><geometry>{mesh}</geometry></collision></link></robot>')
    with pytest.raises(InputError, match="mesh 'meshes/arm.stl' named in .*a.urdf"):
        build_arm(model_of(file, 1))
