"""Grasps across hollow bodies: from outside, over the gap between two walls."""

import numpy as np
import pytest
from contacts_fixtures import HAND

from hmap_core.contacts.camera import visible_points
from hmap_core.contacts.candidates import Situation
from hmap_core.contacts.sampler import candidates
from hmap_core.transforms import IDENTITY, pose
from hmap_core.types import Body, BodyKind, ContactKind, Shape, ShapeKind, TaskMode


def box(size, at) -> Shape:
    return Shape(ShapeKind.BOX, size, pose(at))


def beaker(width: float, wall: float = 0.006, height: float = 0.12) -> Body:
    """A square tube with a bottom."""
    side, off = (width - 2 * wall, wall, height), (width - wall) / 2
    shapes = (
        box((width, width, wall), (0.0, 0.0, (wall - height) / 2)),
        box((wall, width, height), (off, 0.0, 0.0)),
        box((wall, width, height), (-off, 0.0, 0.0)),
        box(side, (0.0, off, 0.0)),
        box(side, (0.0, -off, 0.0)),
    )
    return Body("beaker", BodyKind.MOVABLE, shapes, IDENTITY, 0.15)


def openings(body: Body, spanning: bool, mode=TaskMode.PHYSICAL) -> np.ndarray:
    """Widths of the grasps in the middle of the body's height."""
    rng = np.random.default_rng(0)
    cloud = visible_points(body, IDENTITY, (), (), rng, 600, include_unseen=True)
    sets = candidates(body, cloud, HAND, mode, Situation(IDENTITY), rng, spanning)
    found = [c for s in sets if s.kind == ContactKind.GRASP for c in s.contacts(np.arange(len(s)))]
    return np.array([c.opening for c in found if abs(c.point[2]) < 0.04])


def test_a_hollow_body_is_gripped_at_its_walls_and_from_outside():
    own, across = openings(beaker(0.064), False), openings(beaker(0.064), True)
    assert len(own) and own.min() == pytest.approx(0.006, abs=1e-6)
    assert len(across) and across.min() == pytest.approx(0.064, abs=1e-6)
    assert across.max() == pytest.approx(0.064, abs=1e-6)


def test_what_the_gripper_does_not_span_is_left_out():
    assert len(openings(beaker(0.1), True)) == 0


def test_a_solid_body_has_no_gap():
    solid = Body("solid", BodyKind.MOVABLE, (box((0.05, 0.05, 0.1), (0.0, 0.0, 0.0)),), IDENTITY)
    halves = (box((0.025, 0.05, 0.1), (-0.0125, 0.0, 0.0)), box((0.025, 0.05, 0.1), (0.0125, 0.0, 0.0)))
    assert len(openings(solid, True)) == 0
    assert len(openings(Body("joined", BodyKind.MOVABLE, halves, IDENTITY), True)) == 0


def test_kinematic_tasks_have_no_such_grasps():
    assert len(openings(beaker(0.064), True, TaskMode.KINEMATIC)) == 0
