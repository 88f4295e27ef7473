"""What counts as fallen: a body that rolls about its own axis has not toppled."""

import numpy as np
import pytest

from hmap_core.execution.watcher import _axis, _tilt
from hmap_core.transforms import IDENTITY, from_rpy, multiply
from hmap_core.types import Body, BodyKind, Shape, ShapeKind

LYING = from_rpy((0.0, 0.0, 0.0), (np.pi / 2.0, 0.0, 0.4))


def tilt(kind, size, T_a, T_b, pose=IDENTITY):
    return _tilt(T_a, T_b, _axis(Body("body", BodyKind.MOVABLE, (Shape(kind, size, pose),), IDENTITY, 1.0)))


def turned(T, axis, angle):
    """T (7,), turned about an axis of the body, named by its index."""
    return multiply(T, from_rpy((0.0, 0.0, 0.0), angle * np.eye(3)[axis]))


def test_a_cylinder_that_rolls_has_not_toppled_and_one_that_is_stood_up_has():
    cylinder = ShapeKind.CYLINDER, (0.03, 0.2)
    assert tilt(*cylinder, LYING, turned(LYING, 2, 0.6)) == pytest.approx(0.0, abs=1e-6)
    assert tilt(*cylinder, LYING, turned(LYING, 0, 0.6)) == pytest.approx(0.6)
    assert tilt(*cylinder, IDENTITY, turned(IDENTITY, 0, 0.6)) == pytest.approx(0.6)
    crosswise = from_rpy((0.0, 0.0, 0.0), (np.pi / 2.0, 0.0, 0.0))  # of the shape in its body
    assert tilt(*cylinder, IDENTITY, turned(IDENTITY, 1, 0.6), crosswise) == pytest.approx(0.0, abs=1e-6)


def test_a_ball_never_topples_and_a_box_does_in_all_directions():
    for axis in (0, 1):
        assert tilt(ShapeKind.SPHERE, (0.03,), IDENTITY, turned(IDENTITY, axis, 0.6)) == 0.0
        assert tilt(ShapeKind.BOX, (0.1, 0.1, 0.2), IDENTITY, turned(IDENTITY, axis, 0.6)) == pytest.approx(0.6)
    assert tilt(ShapeKind.BOX, (0.1, 0.1, 0.2), IDENTITY, turned(IDENTITY, 2, 0.6)) == pytest.approx(0.0, abs=1e-6)


def test_a_pose_that_is_not_finite_is_no_small_tilt():
    for kind, size in ((ShapeKind.SPHERE, (0.03,)), (ShapeKind.BOX, (0.1, 0.1, 0.1))):
        assert not tilt(kind, size, IDENTITY, np.full(7, np.nan)) <= 0.5
