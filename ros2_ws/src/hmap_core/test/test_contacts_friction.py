"""The stable push against cases that can be reasoned out, and against brute force."""

import numpy as np
import pytest

from hmap_core.contacts.friction import characteristic_length, cone_generators, in_cone, needed_wrench, stable_pushes

SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * 0.1


def line(x, y0, y1):
    """A contact line on the side whose outward normal is -x."""
    return np.array([[[x, y0], [x, y1]]]), np.array([[-1.0, 0.0]])


def test_the_characteristic_length_of_a_square_and_of_two_feet():
    # mean distance of a unit square from its centre: (sqrt(2) + asinh(1)) / 6
    exact = 0.1 * (np.sqrt(2) + np.arcsinh(1)) / 6
    assert characteristic_length([SQUARE], np.zeros(2)) == pytest.approx(exact, rel=0.01)
    tiny = [SQUARE * 0.01 + [0.3, 0.0], SQUARE * 0.01 - [0.3, 0.0]]
    assert characteristic_length(tiny, np.zeros(2)) == pytest.approx(0.3, rel=1e-4)
    assert characteristic_length([SQUARE, SQUARE], np.zeros(2)) == pytest.approx(exact, rel=0.01)
    wide = [SQUARE + [0.3, 0.0], SQUARE - [0.3, 0.0]]
    assert characteristic_length(wide, np.zeros(2)) == pytest.approx(0.3014, abs=2e-4)


def test_straight_ahead_needs_the_force_to_pass_the_centre():
    ahead = np.array([[0.1, 0.0, 0.0]])
    assert stable_pushes(*line(-0.05, -0.01, 0.01), 0.4, ahead, 0.04)[0]
    # without a sideways force no friction moves the line of the pressing forces onto the centre
    assert not stable_pushes(*line(-0.05, 0.005, 0.02), 0.9, ahead, 0.04)[0]
    assert not stable_pushes(*line(-0.05, 0.03, 0.05), 0.1, ahead, 0.04)[0]


def test_no_pull_and_no_sideways_beyond_the_friction_angle():
    contact = line(-0.05, -0.01, 0.01)
    assert not stable_pushes(*contact, 0.4, np.array([[-0.1, 0.0, 0.0]]), 0.04)[0]
    assert not stable_pushes(*contact, 0.4, np.array([[0.1, 0.06, 0.0]]), 0.04)[0]


def test_all_twists_have_to_be_carried():
    contact = line(-0.05, -0.01, 0.01)
    both = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    assert stable_pushes(*contact, 0.4, both[:1], 0.04)[0]
    assert not stable_pushes(*contact, 0.4, both, 0.04)[0]


def test_membership_agrees_with_random_combinations():
    rng = np.random.default_rng(0)
    for _ in range(200):
        angle = rng.uniform(0, 2 * np.pi)
        normal = np.array([np.cos(angle), np.sin(angle)])
        centre = rng.uniform(-0.05, 0.05, 2)
        ends = np.array(
            [centre + 0.01 * np.array([-normal[1], normal[0]]), centre - 0.01 * np.array([-normal[1], normal[0]])]
        )
        generators = cone_generators(ends[None], normal[None], 0.5)
        assert in_cone(generators, rng.random(4) @ generators[0])[0]
        # a plane that leaves all generators on one side: its normal is outside
        outside = -generators[0].sum(axis=0)
        assert not in_cone(generators, outside)[0]


def test_membership_agrees_with_a_linear_program():
    from scipy.optimize import nnls

    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(300):
        ends, normals = line(-0.05, *np.sort(rng.uniform(-0.04, 0.04, 2)))
        generators = cone_generators(ends, normals, rng.uniform(0.1, 1.0))
        wrench = needed_wrench(rng.normal(size=3) * [1.0, 0.3, 10.0] + [1.0, 0, 0], 0.05)
        wrench /= np.linalg.norm(wrench)
        _, residual = nnls(generators[0].T, wrench)
        if 1e-9 < residual < 1e-6:
            continue
        assert in_cone(generators, wrench)[0] == (residual < 1e-9)
        inside += residual < 1e-9
    assert 20 < inside < 280
