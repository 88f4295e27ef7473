"""The body behind points on a visible surface: spheres are told from boxes, and what was seen is inside."""

import numpy as np
import pytest

from hmap_core import transforms
from hmap_core.contacts.estimate import MIN_DISTANCE, MIN_POINTS, estimate_body, track_body
from hmap_core.types import ShapeKind

NOISE = 0.0005  # m


def cap(center, radius: float, rng, count: int = 400) -> np.ndarray:
    """Points on the upper half of a sphere."""
    direction = rng.normal(size=(count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return center + radius * direction + rng.normal(scale=NOISE, size=(count, 3))


def top_and_side(T, size, rng, count: int = 400) -> np.ndarray:
    """Points on the top and one side of a box."""
    half = 0.5 * np.array(size)
    top = np.c_[rng.uniform(-half[:2], half[:2], (count, 2)), np.full(count, half[2])]
    side = rng.uniform(-half, half, (count, 3))
    side[:, 0] = half[0]
    return transforms.apply(T, np.concatenate([top, side])) + rng.normal(scale=NOISE, size=(2 * count, 3))


@pytest.mark.parametrize("radius", [0.02, 0.04, 0.1])
def test_half_a_sphere_is_a_sphere(radius):
    center = np.array([0.4, -0.2, 0.3])
    body = estimate_body("ball", cap(center, radius, np.random.default_rng(0)))
    assert body.shapes[0].kind is ShapeKind.SPHERE
    assert body.shapes[0].size[0] == pytest.approx(radius + MIN_DISTANCE, abs=0.001)
    assert np.linalg.norm(body.pose[:3] - center) < 0.001


def test_a_turned_box_is_a_box_down_to_the_floor():
    size, yaw = (0.10, 0.05, 0.06), 0.4
    T = transforms.from_rpy((0.5, 0.1, 0.13), (0.0, 0.0, yaw))
    points = top_and_side(T, size, np.random.default_rng(0))
    body = estimate_body("thing", points, floor=0.05)
    (shape,) = body.shapes
    assert shape.kind is ShapeKind.BOX
    bottom, top = body.pose[2] - 0.5 * shape.size[2], body.pose[2] + 0.5 * shape.size[2]
    assert bottom == pytest.approx(0.05 - MIN_DISTANCE, abs=0.002) and top == pytest.approx(
        0.16 + MIN_DISTANCE, abs=0.002
    )
    assert sorted(shape.size[:2]) == pytest.approx(np.array([0.05, 0.10]) + 2 * MIN_DISTANCE, abs=0.004)
    inside = np.abs(transforms.apply(transforms.inverse(body.pose), points)) <= 0.5 * np.array(shape.size)
    assert inside.all(axis=1).mean() > 0.97


def test_a_box_that_hangs_ends_where_it_was_seen_last_without_a_floor():
    points = top_and_side(transforms.pose((0.0, 0.0, 0.5)), (0.1, 0.1, 0.1), np.random.default_rng(0))
    body = estimate_body("thing", points)
    assert body.pose[2] - 0.5 * body.shapes[0].size[2] == pytest.approx(0.45, abs=0.005)


def test_too_few_points_are_nothing():
    assert estimate_body("thing", np.zeros((MIN_POINTS - 1, 3))) is None


def test_a_known_ball_is_followed_by_a_small_part_of_it():
    rng, radius, eye = np.random.default_rng(0), 0.03, np.array([0.0, -0.5, 2.0])
    known = estimate_body("ball", cap(np.zeros(3), radius, rng))
    there = np.array([0.1, 0.05, 0.02])
    seen = cap(there, radius, rng, 2000)
    seen = seen[seen[:, 0] > there[0] + 0.012]  # the rest is hidden
    body = track_body(known, seen, eye)
    assert body.shapes == known.shapes
    assert np.linalg.norm(body.pose[:3] - there) < 0.003


def test_what_does_not_fit_a_known_ball_is_not_followed():
    rng, eye = np.random.default_rng(0), np.array([0.0, 0.0, 2.0])
    known = estimate_body("ball", cap(np.zeros(3), 0.03, rng))
    thing = top_and_side(transforms.pose(), (0.1, 0.1, 0.1), rng)
    assert track_body(known, thing, eye) is None
    assert track_body(estimate_body("thing", thing), thing, eye) is None
    assert track_body(known, thing[: MIN_POINTS - 1], eye) is None
