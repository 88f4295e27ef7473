"""Frames, link hulls and motion bounds of two kinds of arm, against PyBullet and the URDF's own meshes."""

import xml.etree.ElementTree as ElementTree
from functools import lru_cache

import numpy as np
import pybullet_data
import pytest
import trimesh
from core_fixtures import arm, frames, model, random_hull, random_q
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from hmap_core.collision.gjk import signed_distance
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import FINGER_TOLERANCE, LINK_TOLERANCE
from hmap_core.kinematics.simplify import simplify_hull
from hmap_core.kinematics.tree import point_jacobian
from hmap_core.kinematics.urdf import load_urdf
from hmap_core.simulation.client import BulletClient
from hmap_core.transforms import apply, distance, multiply, pose

ARMS = ("panda", "iiwa")
HERE = np.eye(3), np.zeros(3)


class Bullet:
    """The same arm in PyBullet."""

    def __init__(self, name: str):
        self.model = arm(name).model
        self.client = BulletClient()
        self.body = self.client.loadURDF(str(self.model.urdf), useFixedBase=True)
        info = [self.client.getJointInfo(self.body, i) for i in range(self.client.getNumJoints(self.body))]
        self.joint = {j[1].decode(): j[0] for j in info}
        self.link = {j[12].decode(): j[0] for j in info}
        # PyBullet places the base by its centre of mass
        offset = self.client.getDynamicsInfo(self.body, -1)[3:5]
        self.client.resetBasePositionAndOrientation(self.body, *offset)

    def place(self, q, opening: float) -> None:
        for name, value in zip(self.model.joint_names, q, strict=True):
            self.client.resetJointState(self.body, self.joint[name], value)
        if self.model.gripper:
            for name in self.model.gripper.joint_names:
                self.client.resetJointState(self.body, self.joint[name], self.model.gripper.joints(opening)[0])

    def link_pose(self, link: str) -> np.ndarray:
        if link not in self.link:
            return pose()
        state = self.client.getLinkState(self.body, self.link[link], computeForwardKinematics=True)
        return pose(state[4], state[5])


@pytest.fixture(params=ARMS)
def name(request):
    return request.param


@lru_cache
def bullet(name: str) -> Bullet:
    return Bullet(name)


@lru_cache
def meshes(name: str) -> dict[str, np.ndarray]:
    """Vertices of the collision meshes of each link, in its frame."""
    file = arm(name).model.urdf
    out = {}
    for link in ElementTree.parse(file).getroot().findall("link"):
        points = []
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            path = mesh.get("filename").removeprefix("package://")
            path = next(p for p in (file.parent / path, file.parent.parent / path) if p.exists())
            vertices = np.asarray(trimesh.load(path, force="mesh").vertices) * numbers(mesh.get("scale"), 1.0)
            origin = collision.find("origin")
            if origin is not None:
                turn = Rotation.from_euler("xyz", numbers(origin.get("rpy"), 0.0))
                vertices = turn.apply(vertices) + numbers(origin.get("xyz"), 0.0)
            points.append(vertices)
        if points:
            out[link.get("name")] = np.concatenate(points)
    return out


def numbers(text: str | None, default: float) -> np.ndarray:
    return np.array([float(v) for v in text.split()]) if text else np.full(3, default)


def outside(point, vertices, radius) -> float:
    witness = np.zeros((3, 3))
    return signed_distance(np.array([point], float), *HERE, 0.0, np.ascontiguousarray(vertices), *HERE, radius, witness)


def test_end_effector_is_where_pybullet_has_it(name):
    rng = np.random.default_rng(1)
    robot, theirs = arm(name), bullet(name)
    for _ in range(50):
        q = rng.uniform(*robot.model.position_limits)
        theirs.place(q, 0.0)
        expected = multiply(theirs.link_pose(robot.model.end_effector_link), robot.model.T_link_ee)
        apart = distance(robot.end_effector(q), expected)
        assert apart[0] < 1e-6 and apart[1] < 1e-5


@pytest.mark.parametrize("opening", [0.0, 0.05])
def test_link_hulls_hold_the_links_and_little_more(name, opening):
    """Every vertex of the collision meshes is inside; what is outside of them is thinner than the tolerance."""
    rng = np.random.default_rng(2)
    robot, theirs, true = arm(name), bullet(name), meshes(name)
    for _ in range(2):
        q = rng.uniform(*robot.model.position_limits)
        theirs.place(q, opening)
        R, p = robot.frames(q)
        hulls = {}
        for hull in robot.hulls:
            hulls.setdefault(hull.link, []).append((hull, hull.at(opening) @ R[hull.frame].T + p[hull.frame]))
        assert set(hulls) == set(true)
        for link, pieces in hulls.items():
            points = apply(theirs.link_pose(link), true[link])
            for point in points[ConvexHull(points).vertices][::3]:
                assert min(outside(point, vertices, hull.radius) for hull, vertices in pieces) < 1e-5
            for hull, vertices in pieces:
                assert hull.radius <= (FINGER_TOLERANCE if hull.finger else LINK_TOLERANCE) + 1e-6
                assert max(np.linalg.norm(points - v, axis=1).min() for v in vertices) < 1e-5
                center, bound = hull.sphere_at(opening)
                assert np.linalg.norm(hull.at(opening) - center, axis=1).max() + hull.radius <= bound + 1e-9


def test_finger_vertices_meet_when_closed_and_part_with_the_opening():
    robot = arm("panda")
    closed, opened = robot.finger_vertices(0.0), robot.finger_vertices(0.06)
    np.testing.assert_allclose(np.abs(opened - closed) @ [1, 1, 1], 0.03, atol=1e-9)
    assert np.ptp(opened[:, 1]) - np.ptp(closed[:, 1]) == pytest.approx(0.06)
    assert closed[:, 2].max() == pytest.approx(robot.model.gripper.tip_offset, abs=1e-3)
    assert len(arm("iiwa").finger_vertices(0.0)) == 0


def test_self_pairs_leave_out_what_is_ignored(name):
    robot = arm(name)
    ignored = {frozenset(pair) for pair in robot.model.ignored_collisions}
    pairs = {frozenset((robot.hulls[i].link, robot.hulls[j].link)) for i, j in robot.self_pairs}
    assert pairs and not pairs & ignored
    # the home configuration is free
    R, p = robot.frames(robot.model.home)
    witness = np.zeros((3, 3))
    for i, j in robot.self_pairs:
        a, b = robot.hulls[i], robot.hulls[j]
        d = signed_distance(
            a.vertices, R[a.frame], p[a.frame], a.radius, b.vertices, R[b.frame], p[b.frame], b.radius, witness
        )
        assert d > 0.002


@pytest.mark.parametrize("names", [("panda",), ("iiwa", "panda")], ids="+".join)
def test_frames_of_a_model_are_the_product_of_its_transforms(names):
    rng = np.random.default_rng(3)
    world = model(*names)
    for _ in range(10):
        q = random_q(world.chain, rng)
        R, p = frames(world.chain, q)
        for placed in world.arms.values():
            local = q[world.offset[placed.name] : world.offset[placed.name] + placed.arm.n]
            expected = multiply(placed.T_world_base, placed.arm.end_effector(local))
            tip = world.tip(placed.name)
            T = multiply(pose(p[tip], Rotation.from_matrix(R[tip]).as_quat()), world.T_tip_ee(placed.name))
            assert max(distance(T, expected)) < 1e-9
            assert world.frame(placed.name, 0) == 0 and world.frame(placed.name, placed.arm.n) == tip


@pytest.mark.parametrize("name", ARMS)
def test_no_configuration_reaches_beyond_the_span_and_some_come_near_it(name):
    robot = arm(name)
    configurations = np.random.default_rng(6).uniform(*robot.model.position_limits, (4000, robot.n))
    reached = max(np.linalg.norm(robot.frames(q)[1][-1] - robot.p_joint[0]) for q in configurations)
    assert reached <= robot.span <= 1.03 * reached


@pytest.mark.parametrize("names", [("panda",), ("iiwa", "panda")], ids="+".join)
def test_point_jacobian_is_the_derivative(names):
    rng = np.random.default_rng(4)
    chain = model(*names).chain
    n, h = len(chain.lower), 1e-6
    for k in range(40):
        q = random_q(chain, rng) if k % 4 else np.zeros(n)
        R, p = frames(chain, q)
        frame = int(rng.integers(0, n + 1))
        local, d, sign = rng.normal(size=3), rng.normal(size=3), rng.choice([-1.0, 1.0])
        x, row = p[frame] + R[frame] @ local, np.ones(n)
        point_jacobian(R, p, chain.first, chain.prismatic, frame, *x, *d, sign, row)
        expected = np.ones(n)
        for i in range(n):
            ends = [frames(chain, q + s * h * np.eye(n)[i]) for s in (1, -1)]
            up, down = (d @ (pp[frame] + RR[frame] @ local) for RR, pp in ends)
            expected[i] += sign * (up - down) / (2 * h)
        np.testing.assert_allclose(row, expected, atol=1e-7)


def test_no_point_moves_more_than_reach_says(name):
    rng = np.random.default_rng(5)
    robot, chain = arm(name), model(name).chain
    opening = robot.model.gripper.open_opening if robot.model.gripper else 0.0
    share = 0.0
    for k in range(200):
        q = random_q(chain, rng)
        dq = rng.normal(size=robot.n) * 10.0 ** rng.integers(-3, 0)
        if k % 2:
            dq *= np.eye(robot.n)[k // 2 % robot.n]
        bound = chain.reach @ np.abs(dq)
        (Ra, pa), (Rb, pb) = robot.frames(q), robot.frames(q + dq)
        tip = robot.T_tip_ee[:3, 3]
        points = [(hull.frame, hull.at(opening)) for hull in robot.hulls] + [(robot.n, tip[None])]
        for frame, x in points:
            moved = np.linalg.norm(x @ (Rb[frame] - Ra[frame]).T + pb[frame] - pa[frame], axis=1).max()
            assert moved <= bound + 1e-12
            share = max(share, moved / bound)
    assert share > 0.3  # and the bound is no empty one


def test_what_is_held_moves_no_more_than_its_speed_times_the_reach(name):
    rng = np.random.default_rng(8)
    robot, chain = arm(name), model(name).chain
    assert robot.speed(0.0) == 1.0
    for extent in (0.3, 1.0):
        bound_per_rad = robot.speed(extent) * chain.reach
        for k in range(100):
            q = random_q(chain, rng)
            dq = rng.normal(size=robot.n) * 10.0 ** rng.integers(-3, 0)
            if k % 2:
                dq *= np.eye(robot.n)[k // 2 % robot.n]
            points = rng.normal(size=(20, 3))
            points *= extent / np.linalg.norm(points, axis=1, keepdims=True)
            (Ra, pa), (Rb, pb) = robot.frames(q), robot.frames(q + dq)
            moved = np.linalg.norm(points @ (Rb[-1] - Ra[-1]).T + pb[-1] - pa[-1], axis=1).max()
            assert moved <= bound_per_rad @ np.abs(dq) + 1e-12


@pytest.mark.parametrize("tolerance", [0.0005, 0.003, 0.02])
def test_simplified_hulls_contain_the_true_ones_within_their_radius(tolerance):
    rng = np.random.default_rng(6)
    for _ in range(15):
        points = rng.normal(size=(200, 3))
        points = points / np.linalg.norm(points, axis=1, keepdims=True) * rng.uniform(0.02, 0.2, 3)
        vertices, radius = simplify_hull(points, tolerance)
        assert len(vertices) <= len(points)
        assert max(outside(point, vertices, radius) for point in points) < 1e-6
        # a vertex of the inner hull is a vertex of the true one, so nothing is farther out than the radius
        assert all((points == v).all(1).any() for v in vertices)
        assert radius == pytest.approx(max(0.0, *(outside(point, vertices, 0.0) for point in points)), abs=1e-6)


def test_simplifying_leaves_flat_things_and_boxes_alone():
    rng = np.random.default_rng(7)
    box = random_hull(rng, "box")[0]
    vertices, radius = simplify_hull(box, 1e-4)
    assert (len(vertices), radius) == (8, 0.0)
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert simplify_hull(flat, 0.01)[1] == 0.0


def test_a_urdf_that_cannot_be_read_is_named(tmp_path):
    for text, part in [
        (None, "missing.urdf"),
        ("<robot", "broken.urdf"),
        ('<robot><link name="a"><collision><geometry><cone/></geometry></collision></link></robot>', "cone"),
    ]:
        file = tmp_path / (part if part.endswith("urdf") else "cone.urdf")
        if text:
            file.write_text(text)
        with pytest.raises(InputError, match=part) as error:
            load_urdf(file)
        assert error.value.code == Code.INVALID_SCENE


def test_the_models_are_those_of_pybullet_data():
    assert all(str(arm(name).model.urdf).startswith(pybullet_data.getDataPath()) for name in ARMS)
