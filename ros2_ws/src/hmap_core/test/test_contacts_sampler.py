"""Sampled contacts against the geometry of boxes, by another library where distances are concerned."""

import numpy as np
import pytest
from contacts_fixtures import GRIPPER, HAND, TIP, TIP_OFFSET
from geometry_fixtures import box, coal_distance, coal_hull, coal_shape, yaw

from hmap_core.contacts.camera import Cloud, visible_points
from hmap_core.contacts.candidates import Hand, Situation
from hmap_core.contacts.push import slide_twists
from hmap_core.contacts.sampler import sample_contacts, snapped
from hmap_core.contacts.solids import solids
from hmap_core.contacts.surface import sample_surface
from hmap_core.transforms import IDENTITY, apply, multiply, pose, rotation_matrix
from hmap_core.types import Body, BodyKind, ContactKind, Shape, ShapeKind, TaskMode

SIZE = np.array([0.3, 0.06, 0.08])
BAR = box("bar", SIZE, (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.3, friction=0.5)
T_BAR = pose((0.4, 0.0, 0.09), yaw(0.5))
AHEAD = multiply(T_BAR, pose((0.1, 0, 0)))
RESTING = Situation(T_BAR)
# the fingertip meets the surface at this distance at most, m
TOUCHING = 2e-4


def cloud_of(body, n=200, seed=0):
    points, normals = sample_surface(body.shapes, n, np.random.default_rng(seed))
    return Cloud(points, normals, np.ones(n, bool))


def contacts_of(body, mode, situation=RESTING, hand=HAND, n=200, seed=0, batch=256, cloud=None):
    cloud = cloud_of(body, n) if cloud is None else cloud
    batches = list(sample_contacts(body, cloud, hand, mode, situation, np.random.default_rng(seed), batch))
    return [c for b in batches for c in b]


def kind(contacts, which):
    return [c for c in contacts if c.kind == which]


@pytest.mark.parametrize(
    "shape",
    [
        Shape(ShapeKind.BOX, tuple(SIZE)),
        Shape(ShapeKind.CYLINDER, (0.04, 0.1)),
        Shape(ShapeKind.SPHERE, (0.05,)),
    ],
)
def test_a_touching_fingertip_meets_the_surface_without_going_in(shape):
    body = Body("body", BodyKind.MOVABLE, (shape,), pose())
    contacts = contacts_of(body, TaskMode.KINEMATIC, n=60)
    assert len(contacts) > 300
    finger, object_ = coal_hull(TIP), coal_shape(shape)
    leans = []
    for c in contacts[:: len(contacts) // 150]:
        d = coal_distance(finger, c.T_obj_ee, object_, IDENTITY)
        assert 0.0 < d < TOUCHING
        leans.append(np.arccos(np.clip(-rotation_matrix(c.T_obj_ee)[:, 2] @ c.normal, -1, 1)))
        assert c.kind == ContactKind.TOUCH and c.opening == 0.0
        # it comes in along the normal
        np.testing.assert_allclose(rotation_matrix(c.T_obj_ee) @ c.approach, -c.normal, atol=1e-9)
    assert np.ptp(np.rad2deg(leans)) > 55.0


def test_a_pointed_finger_touches_with_its_point():
    point = np.array([[0, 0, 0.01], [0.005, 0, -0.03], [-0.005, 0.005, -0.03], [-0.005, -0.005, -0.03]])
    for c in contacts_of(BAR, TaskMode.KINEMATIC, hand=Hand(point, GRIPPER), n=30)[::20]:
        np.testing.assert_allclose(apply(c.T_obj_ee, point[0]), c.point + 5e-5 * c.normal, atol=1e-9)


def test_grasps_are_antipodal_and_as_wide_as_the_object():
    contacts = contacts_of(BAR, TaskMode.PHYSICAL)
    grasps = kind(contacts, ContactKind.GRASP)
    assert len(grasps) > 300
    assert not kind(contacts, ContactKind.TOUCH)
    for c in grasps:
        R, origin = rotation_matrix(c.T_obj_ee), c.T_obj_ee[:3]
        # only the 60 mm side fits between the fingers: 80 and 300 mm do not
        assert abs(c.normal[1]) == pytest.approx(1.0)
        assert c.opening == pytest.approx(0.06, abs=1e-12)
        assert abs(R[:, 1] @ c.normal) == pytest.approx(1.0)
        assert origin[1] == pytest.approx(0.0, abs=1e-12)  # midway
        # pads over the point, palm clear of the object
        along = (c.point - origin) @ R[:, 2]
        assert -1e-12 <= along <= TIP_OFFSET
        assert ray_to_box(origin, -R[:, 2]) <= HAND.palm_clearance + 1e-9


def ray_to_box(origin, direction):
    with np.errstate(divide="ignore"):
        return np.maximum((SIZE / 2 - origin) / direction, (-SIZE / 2 - origin) / direction).min()


def test_fingers_closed_on_a_grasp_touch_both_faces():
    """Pads at plus and minus half the opening along the closing axis lie on the faces."""
    for c in kind(contacts_of(BAR, TaskMode.PHYSICAL), ContactKind.GRASP)[::25]:
        pads = apply(c.T_obj_ee, np.array([[0, c.opening / 2, 0], [0, -c.opening / 2, 0]]))
        np.testing.assert_allclose(np.sort(pads[:, 1]), [-0.03, 0.03], atol=1e-12)


def test_too_wide_too_slippery_and_handless_give_no_grasp():
    wide = box("wide", (0.2, 0.078, 0.2), (0, 0, 0), friction=0.5)
    assert not kind(contacts_of(wide, TaskMode.PHYSICAL), ContactKind.GRASP)
    assert not kind(contacts_of(BAR, TaskMode.PHYSICAL, hand=Hand(TIP, None)), ContactKind.GRASP)


def test_a_wedge_is_held_only_with_enough_friction(tmp_path):
    h = 2 * 0.06 * np.tan(np.deg2rad(10.3))
    path = tmp_path / "wedge.obj"
    corners = [(x, y, z) for x in (-0.1, 0.1) for y, z in ((-h / 2, -0.03), (h / 2, -0.03), (0.0, 0.03))]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 4 6 5\nf 1 4 2\nf 2 4 5\n")
    # sides lean by 10.3 degrees each, 20.6 between a normal and the opposite one: friction 0.376
    shapes = (Shape(ShapeKind.MESH, (1.0, 1.0, 1.0), pose(), path),)
    for friction, held in ((0.45, True), (0.3, False)):
        wedge = Body("wedge", BodyKind.MOVABLE, shapes, pose(), friction=friction)
        grasps = kind(contacts_of(wedge, TaskMode.PHYSICAL), ContactKind.GRASP)
        assert any(abs(c.normal[1]) > 0.9 for c in grasps) == held


def test_contacts_stay_in_the_graspable_regions():
    region = np.array([[-0.05, -1.0, -1.0], [0.05, 1.0, 1.0]])
    body = Body("bar", BAR.kind, BAR.shapes, BAR.pose, 0.3, 0.5, graspable=(region,))
    for mode in TaskMode:
        contacts = contacts_of(body, mode, Situation(T_BAR, AHEAD))
        assert contacts
        assert max(abs(c.point[0]) for c in contacts) <= 0.05 + 1e-6


def test_pushes_are_at_the_back_of_a_straight_slide():
    contacts = contacts_of(BAR, TaskMode.PHYSICAL, Situation(T_BAR, AHEAD), n=600)
    pushes = kind(contacts, ContactKind.PUSH)
    assert len(pushes) > 20
    finger, object_ = coal_hull(TIP), coal_shape(BAR.shapes[0])
    for c in pushes:
        np.testing.assert_allclose(c.normal, [-1, 0, 0], atol=1e-12)
        # the line of force goes by the centre within the fingertip's half width
        assert abs(c.point[1]) < 0.0131
        assert c.point[2] >= -0.03 - 1e-9
        assert 0.0 < coal_distance(finger, c.T_obj_ee, object_, IDENTITY) < TOUCHING


def test_no_push_lifts_tilts_or_topples():
    up = multiply(T_BAR, pose((0.1, 0, 0.02)))
    assert not kind(contacts_of(BAR, TaskMode.PHYSICAL, Situation(T_BAR, up)), ContactKind.PUSH)
    assert slide_twists(T_BAR, multiply(T_BAR, pose((0, 0, 0), (np.sin(0.1), 0, 0, np.cos(0.1)))), np.zeros(3)) is None
    tower = box("tower", (0.06, 0.06, 0.4), (0, 0, 0), friction=0.5)
    T = pose((0.4, 0, 0.25))
    cloud = cloud_of(tower, 800)
    pushes = kind(
        contacts_of(tower, TaskMode.PHYSICAL, Situation(T, pose((0.5, 0, 0.25))), cloud=cloud), ContactKind.PUSH
    )
    # half of 60 mm over a friction of 0.5: no higher than 60 mm over the table
    assert pushes and max(c.point[2] for c in pushes) <= -0.2 + 0.06 + 1e-9
    assert max(c.point[2] for c in pushes) > -0.2 + 0.04


def test_a_turning_slide_is_pushed_off_centre():
    """To turn left while it goes ahead the bar is pushed right of its centre."""
    wide = box("wide", (0.06, 0.3, 0.06), (0, 0, 0), friction=0.6)
    T = pose((0.4, 0, 0.08))
    for angle, side in ((0.15, -1.0), (-0.15, 1.0)):
        there = pose((0.5, 0, 0.08), yaw(angle))
        pushes = kind(
            contacts_of(wide, TaskMode.PHYSICAL, Situation(T, there), cloud=cloud_of(wide, 1500)), ContactKind.PUSH
        )
        behind = [c for c in pushes if c.normal[0] < -0.9]
        assert len(behind) > 5
        assert np.mean([c.point[1] for c in behind]) * side > 0.004


def test_ranking_batches_and_seeds():
    situation = Situation(T_BAR, AHEAD, np.array([0.0, 0.0, 0.0]))
    cloud = cloud_of(BAR)
    first = contacts_of(BAR, TaskMode.KINEMATIC, situation, seed=5, batch=100, cloud=cloud)
    again = contacts_of(BAR, TaskMode.KINEMATIC, situation, seed=5, batch=77, cloud=cloud)
    other = contacts_of(BAR, TaskMode.KINEMATIC, situation, seed=6, cloud=cloud)
    assert len(first) == len(again) == len(other)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.T_obj_ee, b.T_obj_ee)
    assert any(not np.allclose(a.T_obj_ee, b.T_obj_ee) for a, b in zip(first, other, strict=True))
    scores = np.array([c.score for c in first])
    assert scores[:200].mean() > scores[-200:].mean() + 0.5
    # the first few are not all of one sort
    places = {tuple(np.round(c.point / 0.03).astype(int)) for c in first[:40]}
    assert len(places) >= 8
    sizes = [
        len(b) for b in sample_contacts(BAR, cloud, HAND, TaskMode.KINEMATIC, situation, np.random.default_rng(0), 100)
    ]
    assert sizes[:-1] == [100] * (len(sizes) - 1) and 0 < sizes[-1] <= 100


def test_measured_points_are_put_on_the_known_surface():
    cloud = cloud_of(BAR, 200)
    noise = np.random.default_rng(1).normal(0.0, 0.001, (200, 1))
    own = solids([(s, IDENTITY) for s in BAR.shapes])
    moved = snapped(Cloud(cloud.points + noise * cloud.normals, cloud.normals, cloud.seen), own)
    np.testing.assert_allclose(moved.points, cloud.points, atol=1e-9)
    far = snapped(Cloud(cloud.points + 0.05 * cloud.normals, cloud.normals, cloud.seen), own)
    assert len(far) == 0


def test_nothing_seen_gives_no_contact():
    empty = visible_points(BAR, T_BAR, [], [], np.random.default_rng(0))
    assert contacts_of(BAR, TaskMode.KINEMATIC, cloud=empty) == []
