"""Contacts that a held body makes, how far pushes serve, where there is room to touch, and what a grasp can lift."""

import numpy as np
import pytest
from contacts_fixtures import GRIPPER, HAND
from geometry_fixtures import box, coal_distance, coal_shape, yaw

from hmap_core.contacts.access import accessible
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import CONTACT_GAP, Hand, Situation
from hmap_core.contacts.facets import attached_facets, facet_poses, facets
from hmap_core.contacts.grasp_torque import GRAVITY, pad_balance, weight_torque_ratio
from hmap_core.contacts.push import push_reach
from hmap_core.contacts.sampler import sample_contacts
from hmap_core.contacts.solids import solids
from hmap_core.contacts.surface import sample_surface
from hmap_core.transforms import IDENTITY, apply, from_rpy, interpolate, inverse, multiply, pose, rotation_matrix
from hmap_core.types import AttachedBody, BodyKind, ContactKind, ContactPoint, Shape, ShapeKind, TaskMode

BRICK = box("brick", (0.10, 0.06, 0.06), (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.3, friction=0.5)
STICK = Shape(ShapeKind.BOX, (0.40, 0.04, 0.04))
T_HOLD = from_rpy((0.12, 0.0, 0.0), (np.pi, 0.0, 0.0))  # of the hand, from above, in the stick's frame
HELD = AttachedBody("stick", (STICK,), inverse(T_HOLD), 0.04, 0.5, np.array([0.0, 0.0, 1.0]))
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])
WITH_TOOL = Hand(apply(inverse(T_HOLD), CORNERS), None, HELD)
T_BRICK = pose((0.5, 0.1, 0.03), yaw(0.3))


def cloud_of(body, n=150):
    points, normals = sample_surface(body.shapes, n, np.random.default_rng(0))
    return Cloud(points, normals, np.ones(n, bool))


def contacts_with_stick(mode, T_next):
    situation = Situation(T_BRICK, T_next)
    return [
        c
        for b in sample_contacts(BRICK, cloud_of(BRICK), WITH_TOOL, mode, situation, np.random.default_rng(1))
        for c in b
    ]


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (Shape(ShapeKind.BOX, (0.1, 0.2, 0.3)), 6),
        (Shape(ShapeKind.CYLINDER, (0.05, 0.2)), 14),
        (Shape(ShapeKind.SPHERE, (0.05,)), 14),
        (Shape(ShapeKind.CAPSULE, (0.02, 0.1)), 14),
    ],
)
def test_facets_are_on_the_surface_and_foremost(shape, count):
    moved = Shape(shape.kind, shape.size, from_rpy((0.3, -0.1, 0.2), (0.4, 0.5, 0.6)))
    found = facets([moved])
    assert len(found) == count
    ball = coal_shape(Shape(ShapeKind.SPHERE, (1e-4,)))
    for facet in found:
        assert np.linalg.norm(facet.normal) == pytest.approx(1.0)
        for corner in facet.vertices:
            assert coal_distance(ball, pose(corner + 5e-4 * facet.normal), coal_shape(shape), moved.pose) > 0.0
            assert coal_distance(ball, pose(corner - 1e-3 * facet.normal), coal_shape(shape), moved.pose) < 5e-4


def test_a_facet_is_laid_on_points_whatever_the_roll():
    up = rotation_matrix(HELD.T_ee_body) @ HELD.up
    cloud = cloud_of(BRICK, 20)
    for facet in attached_facets(HELD):
        R, origin, upright, index = facet_poses(
            facet, up, cloud.points, cloud.normals, FORWARD_UP, np.random.default_rng(0)
        )
        assert len(R) == len(origin) == len(upright) == len(index) == 80
        for r, p, k in zip(R, origin, index, strict=True):
            assert np.linalg.det(r) == pytest.approx(1.0)
            np.testing.assert_allclose(r @ facet.normal, -cloud.normals[k], atol=1e-9)
            height = (facet.vertices @ r.T + p - cloud.points[k]) @ cloud.normals[k]
            np.testing.assert_allclose(height, CONTACT_GAP, atol=1e-9)


FORWARD_UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("mode", list(TaskMode))
def test_a_held_stick_meets_the_object_without_going_in(mode):
    contacts = contacts_with_stick(mode, multiply(T_BRICK, pose((0.1, 0, 0))))
    assert len(contacts) > 50
    kind = ContactKind.TOUCH if mode == TaskMode.KINEMATIC else ContactKind.PUSH
    for c in contacts[:: len(contacts) // 40]:
        assert c.kind == kind
        T_obj_stick = multiply(c.T_obj_ee, HELD.T_ee_body)
        assert 0.0 < coal_distance(coal_shape(STICK), T_obj_stick, coal_shape(BRICK.shapes[0]), IDENTITY) < 2e-4


def test_a_push_serves_up_to_the_corner_of_the_path():
    there = multiply(T_BRICK, pose((0.1, 0, 0)))
    legs = [T_BRICK, there, multiply(there, pose((0, 0.1, 0)))]
    path = np.concatenate([interpolate(a, b, np.linspace(0, 1, 11))[:-1] for a, b in zip(legs, legs[1:], strict=False)])
    contacts = contacts_with_stick(TaskMode.PHYSICAL, path[1])
    reach = push_reach(BRICK, WITH_TOOL, contacts, path)
    assert (reach == 10).sum() > 0.5 * len(contacts)
    assert reach.max() == 10
    lifted = np.concatenate([path[:5], path[5:] + [0, 0, 0.05, 0, 0, 0, 0]])
    assert push_reach(BRICK, WITH_TOOL, contacts, lifted).max() == 4


def test_grasps_serve_as_far_as_the_path_goes():
    path = interpolate(T_BRICK, multiply(T_BRICK, pose((0, 0, 0.2))), np.linspace(0, 1, 6))
    grasp = ContactPoint(ContactKind.GRASP, IDENTITY, np.zeros(3), np.array([0, 1.0, 0]), 0.06, FORWARD_UP)
    assert push_reach(BRICK, HAND, [grasp], path).tolist() == [5]


def test_places_close_before_a_wall_cannot_be_touched():
    wall = box("wall", (1.0, 0.02, 0.2), (0, 0, 0))
    T_wall = multiply(T_BRICK, pose((0.0, 0.045, 0.0)))  # 5 mm beside the brick's face at y = 0.03
    cloud = cloud_of(BRICK)
    around = solids([(shape, T_wall) for shape in wall.shapes])
    hidden = cloud.normals[:, 1] > 0.5
    assert (accessible(cloud, T_BRICK, around, 0.008) == ~hidden).all()
    assert accessible(cloud, T_BRICK, around, 0.004).all()


def test_the_weight_beside_the_grip_uses_up_the_friction_of_the_pads():
    up = np.array([0.0, 0.0, 1.0])
    capacity = 4.0 / 3.0 * BRICK.friction * GRIPPER.force * GRIPPER.pad_half_width
    for x in (0.0, 0.02, 0.04):
        T = from_rpy((x, 0.0, 0.0), (np.pi, 0.0, 0.0))  # closes along y
        grasp = ContactPoint(ContactKind.GRASP, T, np.zeros(3), np.array([0, 1.0, 0]), 0.06, FORWARD_UP)
        share = weight_torque_ratio(BRICK, [grasp], GRIPPER, up)
        assert share[0] == pytest.approx(BRICK.mass * GRAVITY * x / capacity, abs=1e-9)
    across = ContactPoint(
        ContactKind.GRASP, from_rpy((0.04, 0, 0), (np.pi, 0, np.pi / 2)), np.zeros(3), up, 0.06, FORWARD_UP
    )
    assert weight_torque_ratio(BRICK, [across], GRIPPER, up)[0] == pytest.approx(0.0, abs=1e-9)


def test_a_pad_over_an_edge_is_uneven():
    def grasp(x):
        T = from_rpy((x, 0.0, 0.02), (np.pi, 0.0, 0.0))  # pads along x
        return ContactPoint(
            ContactKind.GRASP, T, np.array([x, 0.03, 0.02]), np.array([0.0, 1.0, 0.0]), 0.06, FORWARD_UP
        )

    half = GRIPPER.pad_half_width
    even = pad_balance(BRICK, [grasp(x) for x in (0.0, 0.05 - half, 0.05 - half / 2, 0.05 - 1e-3)], GRIPPER)
    assert even[0] == even[1] == 1.0
    assert 0.3 < even[2] <= 0.5
    assert even[3] <= 0.11
    push = ContactPoint(ContactKind.PUSH, IDENTITY, np.zeros(3), np.array([0, 1.0, 0]), 0.0, FORWARD_UP)
    assert pad_balance(BRICK, [push], GRIPPER).tolist() == [1.0]
