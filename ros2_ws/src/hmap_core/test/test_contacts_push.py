"""Pushes that have room before they slip, and the directions in which an object can be pushed like that."""

import numpy as np
import pytest
from contacts_fixtures import GRIPPER, HAND
from geometry_fixtures import box, yaw

from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Hand, Situation
from hmap_core.contacts.friction import stable_pushes
from hmap_core.contacts.grasp_torque import GRAVITY, push_torque_ratio
from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.push import ATTACHED_CLEARANCE, SlidingBody, slide_twists
from hmap_core.contacts.push_path import sides
from hmap_core.contacts.sampler import sample_contacts
from hmap_core.contacts.surface import sample_surface
from hmap_core.transforms import apply, from_rpy, inverse, multiply, pose, rotation_matrix
from hmap_core.types import AttachedBody, Body, BodyKind, ContactKind, ContactPoint, Shape, ShapeKind, TaskMode

CRATE = box("crate", (0.10, 0.06, 0.06), (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.3, friction=0.5)
STICK = Shape(ShapeKind.BOX, (0.40, 0.06, 0.06))
T_HOLD = from_rpy((0.12, 0.0, 0.0), (np.pi, 0.0, 0.0))  # of the hand, from above, in the stick's frame
HELD = AttachedBody("stick", (STICK,), inverse(T_HOLD), 0.06, 0.5, np.array([0.0, 0.0, 1.0]))
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.03, 0.03) for z in (-0.03, 0.03)])
WITH_TOOL = Hand(apply(inverse(T_HOLD), CORNERS), None, HELD)
T_CRATE = pose((0.5, 0.1, 0.03), yaw(0.3))
AHEAD = multiply(T_CRATE, pose((0.01, 0, 0)))
TALL = box("tall", (0.10, 0.06, 0.20), (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.3, friction=0.8)
OCTAGON = Body(
    "octagon",
    BodyKind.MOVABLE,
    tuple(Shape(ShapeKind.BOX, (0.09, 0.41421356 * 0.09, 0.02), pose((0, 0, 0), yaw(k * np.pi / 4))) for k in range(4)),
    T_CRATE,
    mass=0.2,
    friction=0.6,
)


def pushes_of(body, hand, T_next=AHEAD, n=400, support_friction=None):
    points, normals = sample_surface(body.shapes, n, np.random.default_rng(0))
    cloud = Cloud(points, normals, np.ones(n, bool))
    situation = Situation(T_CRATE, T_next, support_friction=support_friction)
    batches = sample_contacts(body, cloud, hand, TaskMode.PHYSICAL, situation, np.random.default_rng(1))
    return [c for batch in batches for c in batch if c.kind == ContactKind.PUSH]


def test_a_stick_as_wide_as_the_object_can_follow_it_into_a_narrow_channel():
    def fits(contact):
        corners = apply(multiply(contact.T_obj_ee, HELD.T_ee_body), CORNERS)
        beside, below = np.abs(corners[:, 1]).max() - 0.03, -0.03 - corners[:, 2].min()
        return beside < 1e-6 and below <= -ATTACHED_CLEARANCE + 1e-6

    contacts = pushes_of(CRATE, WITH_TOOL)
    assert sum(fits(c) for c in contacts) >= 20


def test_only_sides_that_can_push_are_asked_and_none_of_these_is_left_out():
    slide = SlidingBody(CRATE, T_CRATE)
    angle = np.linspace(-np.pi, np.pi, 73)[:-1] + 0.01
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    twists = slide_twists(T_CRATE, AHEAD, slide.centre)
    able = slide.behind(normals, twists, 0.5)
    flat = (normals @ slide.level.T)[:, :2]
    across = np.stack([-flat[:, 1], flat[:, 0]], axis=1)[:, None] * np.array([-1.0, 1.0])[:, None]
    everywhere = stable_pushes(across, flat, 0.5, twists, slide.length)  # lines of 2 m, so that any moment is possible
    assert (able == everywhere).all()
    assert 0 < able.sum() < len(able) / 4


def test_pushes_past_the_middle_come_first():
    levers = [abs(np.cross(c.normal, c.point)[2]) for c in pushes_of(CRATE, HAND)]
    assert max(levers[:20]) < 0.006
    assert max(levers) > 0.008


def test_what_a_push_turns_the_tool_by_is_friction_at_the_lever_of_the_grip():
    way = np.array([-1.0, 0.0, 0.0])
    low = ContactPoint(ContactKind.PUSH, T_HOLD, np.array([-0.05, 0.0, 0.0]), way, 0.0, np.array([0, 0, 1.0]))
    lifted = ContactPoint(ContactKind.PUSH, T_HOLD, np.array([-0.05, 0.0, 0.04]), way, 0.0, np.array([0, 0, 1.0]))
    capacity = 4.0 / 3.0 * HELD.friction * GRIPPER.force * GRIPPER.pad_half_width
    share = push_torque_ratio(HELD, GRIPPER, CRATE, [low, lifted])
    assert share == pytest.approx([0.0, CRATE.friction * CRATE.mass * GRAVITY * 0.04 / capacity], abs=1e-9)
    assert push_torque_ratio(HELD, GRIPPER, CRATE, []).shape == (0,)


def test_a_hand_that_leans_a_little_may_come_almost_along_itself():
    def of(contact):
        R = rotation_matrix(contact.T_obj_ee)
        return np.rad2deg(np.arccos(-R[2, 2])), np.degrees(np.arccos(-(R @ contact.approach)[2]))

    leaning = [of(contact) for contact in pushes_of(CRATE, HAND)]
    steep = {round(lean) for lean, way in leaning if way < 30.0}
    assert steep == {15, 30}
    assert {0, 60, 90} <= {round(lean) for lean, _ in leaning}


def test_how_high_a_push_may_be_is_up_to_the_friction_with_the_support():
    def highest(support_friction):
        return 0.10 + max(c.point[2] for c in pushes_of(TALL, HAND, n=2000, support_friction=support_friction))

    low, high = highest(None), highest(0.3)
    assert 0.05 < low <= 0.05 / 0.8 < high <= 0.05 / 0.3
    assert highest(0.9) == low  # the lower one of both counts


@pytest.mark.parametrize(("body", "count"), [(CRATE, 4), (OCTAGON, 8)])
def test_the_sides_of_what_is_pushed(body, count):
    found = sides(body, SlidingBody(body, T_CRATE))
    angle = np.sort(np.mod([side.heading - 0.3 for side in found], 2 * np.pi))
    assert len(found) == count
    np.testing.assert_allclose(np.mod(angle * count / (2 * np.pi) + 0.5, 1.0), 0.5, atol=1e-6)


def test_a_side_that_is_not_before_the_middle_is_none_and_one_goes_farther_to_one_hand():
    foot = (Shape(ShapeKind.BOX, (0.20, 0.04, 0.04)), Shape(ShapeKind.BOX, (0.02, 0.10, 0.04), pose((0.09, 0.07, 0.0))))
    hook = Body("hook", BodyKind.MOVABLE, foot, pose((0, 0, 0.02)), mass=0.2, friction=0.6)
    slide = SlidingBody(hook, pose((0, 0, 0.02)))
    found = {round(np.rad2deg(side.heading)): side.curvature for side in sides(hook, slide)}
    assert -90 not in found  # the end of its arm is beside the middle, and nothing flat goes from there to its foot
    right, left = np.array(found[90]) * slide.length**2  # of the long side that is pushed along y
    np.testing.assert_allclose([right, left], [-0.1 + 0.01 - slide.middle[0], 0.1 - 0.01 - slide.middle[0]], atol=1e-6)


def test_what_is_wider_than_the_gripper_opens_cannot_be_gripped():
    wide = box("wide", (0.09, 0.09, 0.02), (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.2)
    assert grippable(CRATE, T_CRATE, [HAND])
    assert not grippable(wide, T_CRATE, [HAND])
    assert not grippable(OCTAGON, T_CRATE, [HAND])
    assert not grippable(CRATE, T_CRATE, [Hand(HAND.tip, None)])
