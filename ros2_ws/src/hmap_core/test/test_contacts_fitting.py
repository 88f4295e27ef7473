"""Grasps on things made of several parts: the fingers close on the faces, and not into what is beside these."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import HOME, panda_model

from hmap_core import transforms
from hmap_core.contacts.hand import drop_unfit_grasps
from hmap_core.types import Body, BodyKind, ContactKind, ContactPoint, Robot, Shape, ShapeKind

FROM_ABOVE = (0.0, 1.0, 0.0, 0.0)
BAR = Shape(ShapeKind.BOX, (0.2, 0.04, 0.04))
KNOB = Shape(ShapeKind.BOX, (0.01, 0.008, 0.04), transforms.pose((0.03, 0.024, 0.0)))  # beside one of the faces
ARM = Robot("arm", panda_model(), transforms.pose(), HOME.copy())


def body(*shapes: Shape) -> Body:
    return Body("bar", BodyKind.MOVABLE, shapes, transforms.pose((0.5, 0.0, 0.02)), 0.3, 0.6)


def grasp(x: float, opening: float = 0.04) -> ContactPoint:
    """From above across the bar, the pads about as far as ``x`` (m) from its middle."""
    T, point = transforms.pose((x, 0.0, 0.0), FROM_ABOVE), np.array([x, 0.02, 0.0])
    return ContactPoint(ContactKind.GRASP, T, point, np.array([0.0, 1.0, 0.0]), opening, np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize(
    "contact, fits",
    [
        (grasp(0.0), True),
        (grasp(0.07), True),
        (grasp(0.04), False),  # a finger would close into the knob
        (grasp(0.03), False),
        (grasp(0.0, 0.045), False),  # the fingers would not touch the object
        (grasp(0.0, 0.036), False),  # they would be inside of the bar
    ],
)
def test_fingers_close_on_the_faces_alone(contact, fits):
    assert (drop_unfit_grasps(body(BAR, KNOB), [contact], ARM) == [contact]) == fits


def test_a_single_box_has_nothing_beside_its_faces():
    contacts = [grasp(0.03), grasp(0.07)]
    assert drop_unfit_grasps(body(BAR), contacts, ARM) == contacts


def test_what_only_touches_is_let_through():
    push = replace(grasp(0.03), kind=ContactKind.PUSH)
    assert drop_unfit_grasps(body(BAR, KNOB), [push], ARM) == [push]
