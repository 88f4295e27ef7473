"""The judge's own geometry and kinematics against independent ones."""

import math

import numpy as np
import pybullet
import pytest
import validation_fixtures as plans
from scipy.spatial.transform import Rotation, Slerp

from hmap_core.validation import arm, document, rigid
from hmap_core.validation.geometry import Boxes, Gauge, Polytope, box_gap, hull, solid, transform
from hmap_core.validation.reader import Reader
from hmap_core.validation.support import SAMPLED_DEPTH, SupportFinder, _sampled_interior, overlap
from hmap_core.validation.world import World

PANDA = "pybullet_data://franka_panda/panda.urdf"
NAMES = [f"panda_joint{i}" for i in range(1, 8)]
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
BASE = [0.1, -0.2, 0.3, 0.0, 0.0, math.sin(0.4), math.cos(0.4)]
SOLIDS = {
    "box": solid("box", (0.1, 0.2, 0.3)),
    "cylinder": solid("cylinder", (0.05, 0.2)),
    "sphere": solid("sphere", (0.07,)),
    "capsule": solid("capsule", (0.04, 0.1)),
    "hull": hull(np.random.default_rng(5).normal(size=(40, 3)) * [0.03, 0.05, 0.08], "hull"),
}


@pytest.fixture(scope="module")
def panda():
    fingers = ["panda_finger_joint1", "panda_finger_joint2"]
    links = ["panda_leftfinger", "panda_rightfinger"]
    robot = {
        "urdf": PANDA,
        "base_pose": BASE,
        "joint_names": NAMES,
        "q_start": [0.0] * 7,
        "end_effector_link": "panda_hand",
        "T_link_ee": [0, 0, 0.105, 0, 0, 0, 1],
        "position_limits": [LOWER.tolist(), UPPER.tolist()],
        "velocity_limits": [2.0] * 7,
        "acceleration_limits": [10.0] * 7,
        "gripper": {"joint_names": fingers, "per_joint": 0.5, "finger_links": links},
    }
    return arm.build(document._robot("panda", Reader(robot, "robot")))


def random_frames(rng, n: int, spread: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    return Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-spread, spread, (n, 3))


def test_link_frames_agree_with_pybullet(panda):
    rng = np.random.default_rng(1)
    q, opening = rng.uniform(LOWER, UPPER, (5, 7)), rng.uniform(0.0, 0.08, 5)
    frames = panda.frames(panda.values(q, opening))
    client = pybullet.connect(pybullet.DIRECT)
    path = str(arm.urdf.locate(PANDA))
    body = pybullet.loadURDF(path, BASE[:3], BASE[3:], useFixedBase=True, physicsClientId=client)
    joints = {pybullet.getJointInfo(body, j, client)[1].decode(): j for j in range(pybullet.getNumJoints(body, client))}
    for k in range(5):
        for name, value in zip(NAMES, q[k], strict=True):
            pybullet.resetJointState(body, joints[name], value, physicsClientId=client)
        for name in ("panda_finger_joint1", "panda_finger_joint2"):
            pybullet.resetJointState(body, joints[name], opening[k] / 2, physicsClientId=client)
        for j in joints.values():
            link = pybullet.getJointInfo(body, j, client)[12].decode()
            state = pybullet.getLinkState(body, j, computeForwardKinematics=True, physicsClientId=client)
            np.testing.assert_allclose(frames[link][1][k], state[4], atol=2e-6)
            np.testing.assert_allclose(frames[link][0][k], Rotation.from_quat(state[5]).as_matrix(), atol=2e-6)
    pybullet.disconnect(client)


def test_motion_bounds_hold_and_are_not_wild(panda):
    """No point of a link moves more than the bound between two samples, which is under 1 m for each radian turned."""
    rng = np.random.default_rng(2)
    for shape in panda.tree.shapes:
        if not panda.moving(shape.link):
            continue
        q = rng.uniform(LOWER, UPPER)
        pair = np.array([q, q + rng.uniform(-0.05, 0.05, 7)])
        values = panda.values(pair, np.array([0.02, 0.021]))
        points = shape.solid.points @ shape.R.T + shape.p
        reach = float(np.linalg.norm(points, axis=1).max())
        bound = panda.motions([shape.link], values, panda.frames(values))[shape.link].speed(reach)[0]
        s = np.linspace(0.0, 1.0, 201)
        fine = {name: v[0] + s * (v[1] - v[0]) for name, v in values.items()}
        R, p = panda.frames(fine)[shape.link]
        world = np.einsum("kij,vj->kvi", R, points) + p[:, None]
        travelled = np.linalg.norm(np.diff(world, axis=0), axis=2).sum(axis=0).max()
        assert travelled <= bound + 1e-12
        assert bound < 0.35  # seven joints by at most 0.05 rad


def test_adjacent_links_of_the_panda(panda):
    assert panda.adjacent("panda_link3", "panda_link4")
    assert panda.adjacent("panda_link7", "panda_hand")  # joined rigidly through panda_link8
    assert panda.adjacent("panda_leftfinger", "panda_hand")
    assert not panda.adjacent("panda_link6", "panda_hand")
    assert not panda.adjacent("panda_leftfinger", "panda_rightfinger")


@pytest.mark.parametrize("name", ["box", "cylinder", "capsule", "hull"])
def test_distance_to_a_sphere_agrees_with_a_projection(name):
    """Outside a convex shape the distance to a sphere is that of its centre from the shape, less the radius."""
    rng = np.random.default_rng(3)
    shape, sphere = SOLIDS[name], SOLIDS["sphere"]
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    support = (directions @ shape.points.T).max(axis=1) + shape.ball
    for center in rng.uniform(-0.6, 0.6, (20, 3)):
        # the distance is the largest separation over all directions; 4000 of them come close from below
        expected = (directions @ center - support).max()
        T = transform(np.eye(3), np.zeros(3)), transform(np.eye(3), center)
        measured = Gauge(shape, sphere).distance(*T) + 0.07
        if expected > 0.05:
            assert expected - 1e-4 <= measured <= expected + 0.006  # the cylinder's points are 0.06 mm inside it


def test_depth_of_boxes_is_the_smallest_way_out():
    a, b = solid("box", (1.0, 0.08, 0.08)), solid("box", (0.9, 0.03, 0.14))
    T = transform(np.eye(3), np.zeros(3))
    for depth in (0.0, 1e-4, 1e-3, 0.02, 0.05):
        moved = transform(np.eye(3), np.array([0.0, 0.055 - depth, 0.02]))
        assert Gauge(a, b).distance(T, moved) == pytest.approx(-depth, abs=1e-6)


@pytest.mark.parametrize("first", SOLIDS)
@pytest.mark.parametrize("second", SOLIDS)
def test_box_gap_is_a_lower_bound(first, second):
    rng = np.random.default_rng(4)
    a, b = SOLIDS[first], SOLIDS[second]
    Ra, pa = random_frames(rng, 40)
    Rb, pb = random_frames(rng, 40)
    bound = box_gap(Boxes.around(a, Ra, pa), Boxes.around(b, Rb, pb))
    gauge = Gauge(a, b)
    measured = np.array([gauge.distance(transform(Ra[k], pa[k]), transform(Rb[k], pb[k])) for k in range(40)])
    assert np.all(bound <= measured + 1e-9)
    assert np.any(bound > 0.0)


def test_centroid_and_volume_of_a_hull():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    tetrahedron = hull(corners, "tetrahedron")
    assert tetrahedron.volume == pytest.approx(1 / 6)
    np.testing.assert_allclose(tetrahedron.centroid, [0.25, 0.25, 0.25], atol=1e-12)


def test_slerp_and_angles_agree_with_scipy():
    rng = np.random.default_rng(6)
    a, b = Rotation.random(20, rng=rng).as_quat(), Rotation.random(20, rng=rng).as_quat()
    b[0] = a[0]
    b[1] = -a[1]  # the same rotation
    s = rng.uniform(0.0, 1.0, 20)
    mine = Rotation.from_quat(rigid.slerp(a, b, s))
    for k in range(20):
        theirs = Slerp([0.0, 1.0], Rotation.from_quat([a[k], b[k]]))(s[k])
        assert (mine[k].inv() * theirs).magnitude() < 1e-7
    expected = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()
    np.testing.assert_allclose(rigid.angle_between(a, b), expected, atol=1e-7)
    np.testing.assert_allclose(
        rigid.rotation_angle(Rotation.from_quat(b).as_matrix()), Rotation.from_quat(b).magnitude(), atol=1e-7
    )


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.04, 0.0), (0.045, 0.03), (0.3, 0.3)])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_overlap_of_a_box_with_its_support_is_the_same_from_any_point_inside(shift, angle, monkeypatch):
    R = Rotation.from_euler("z", angle).as_matrix()
    standing = SOLIDS["box"].points @ R.T + [*shift, 0.149]  # 1 mm deep
    support = solid("box", (0.1, 0.1, 0.2)).points - [0.0, 0.0, 0.1]
    bodies = Polytope.of(standing), Polytope.of(support)
    guessed = overlap(*bodies)
    monkeypatch.setattr("hmap_core.validation.support._sampled_interior", lambda *_: None)
    exact = overlap(*bodies)
    assert (guessed is None) == (exact is None) == (shift[0] == 0.3)
    if exact is not None:
        near = np.linalg.norm(guessed[:, None] - exact[None], axis=2)
        assert near.min(axis=0).max() < 1e-9
        assert near.min(axis=1).max() < 1e-9


@pytest.mark.parametrize(("gap", "meets"), [(-1e-3, True), (-3e-7, True), (-1e-7, False), (0.0, False), (0.01, False)])
def test_boxes_side_by_side_overlap_only_when_a_ball_fits_between(gap, meets):
    a = SOLIDS["box"].points
    assert (overlap(Polytope.of(a), Polytope.of(a + [0.1 + gap, 0.02, 0.01])) is not None) == meets


def test_a_guessed_point_is_inside_both():
    a, b = SOLIDS["box"].points + [0.0, 0.0, 0.149], solid("box", (1.0, 1.0, 0.2)).points - [0.0, 0.0, 0.1]
    x, y, z = _sampled_interior(Polytope.of(a), Polytope.of(b))
    assert abs(x) < 0.05 - SAMPLED_DEPTH
    assert abs(y) < 0.1 - SAMPLED_DEPTH
    assert -1e-3 + SAMPLED_DEPTH < z < -SAMPLED_DEPTH


def test_overlap_of_two_boxes_is_their_common_box():
    a = SOLIDS["box"].points
    shift = np.array([0.04, 0.05, 0.06])
    corners = overlap(Polytope.of(a), Polytope.of(a + shift))
    np.testing.assert_allclose(corners.min(axis=0), shift - [0.05, 0.1, 0.15], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), [0.05, 0.1, 0.15], atol=1e-9)
    assert overlap(Polytope.of(a), Polytope.of(a + [0.2, 0.0, 0.0])) is None


@pytest.mark.parametrize("name", ["box", "cylinder", "hull"])
def test_faces_of_a_placed_shape_are_those_of_its_hull(name):
    (R,), (p,) = random_frames(np.random.default_rng(8), 1)
    placed = Polytope.around(SOLIDS[name], R, p)
    middle = placed.points.mean(axis=0)
    for share in (0.5, 0.999, 1.001, 2.0):  # points on rays from the middle through the vertices
        points = middle + share * (placed.points - middle)
        depth = (points @ placed.faces[:, :3].T + placed.faces[:, 3]).max(axis=1)
        assert np.all(depth < 0.0) if share < 1.0 else np.all(depth > 0.0)


UPRIGHT, LYING = [0.0, 0.0, 0.0, 1.0], [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
EIGHTH = [math.sin(math.pi / 8), 0.0, 0.0, math.cos(math.pi / 8)]
RESTING = [
    ("box", [0.06, 0.06, 0.06], 0.03, UPRIGHT, True),
    ("box", [0.06, 0.06, 0.06], 0.0309, UPRIGHT, True),  # within the tolerance
    ("box", [0.06, 0.06, 0.06], 0.032, UPRIGHT, False),
    ("box", [0.06, 0.06, 0.06], 0.03 * math.sqrt(2), EIGHTH, False),  # on its edge
    ("cylinder", [0.03, 0.02], 0.01, UPRIGHT, True),
    ("cylinder", [0.03, 0.1], 0.03, LYING, True),
    ("sphere", [0.03], 0.03, UPRIGHT, True),
    ("capsule", [0.03, 0.1], 0.03, LYING, True),
    ("capsule", [0.03, 0.1], 0.2, LYING, False),
]


@pytest.mark.parametrize(("kind", "size", "height", "quaternion", "stable"), RESTING)
def test_support_of_shapes_on_the_table(tmp_path, kind, size, height, quaternion, stable):
    plan = plans.carry(plans.write_gantry(tmp_path))
    thing = plans.box("thing", (1, 1, 1), (0.5, 0.0, 0.0))
    thing |= {"shape": kind, "size": size, "pose": [0.5, 0.0, height, *quaternion]}
    plan["scene"]["bodies"].append(thing)
    support = SupportFinder(World(document.read(plan))).at("thing", 0)
    assert support.stable is stable
    assert support.bodies == ({"table"} if height < 0.1 and height != 0.032 else set())


def test_a_compound_stands_on_all_its_parts(tmp_path):
    plan = plans.carry(plans.write_gantry(tmp_path))
    legs = [{"shape": "box", "size": [0.02, 0.1, 0.1], "pose": plans.pose(x, 0.0, -0.05)} for x in (-0.1, 0.1)]
    top = {"shape": "box", "size": [0.3, 0.1, 0.02], "pose": plans.pose(0.0, 0.0, 0.01)}
    thing = {"name": "stool", "kind": "movable", "shape": "compound", "parts": [*legs, top], "friction": 0.5}
    plan["scene"]["bodies"].append(thing | {"pose": plans.pose(0.5, 0.0, 0.1)})
    support = SupportFinder(World(document.read(plan))).at("stool", 0)
    assert support.stable and support.inside == pytest.approx(0.05, abs=1e-6)
