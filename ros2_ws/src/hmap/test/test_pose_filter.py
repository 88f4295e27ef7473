"""Noise of a body that stands is averaged; one that moves is where it was measured last."""

import numpy as np
import pytest

from hmap.perception.pose_filter import FEWEST, filtered
from hmap_core import transforms

NOISE = 0.001  # m
COUNT = 100


def measured(way, rng, noise=NOISE):
    """Poses (COUNT, 7) along a way (m) in x, with noise."""
    return [
        np.concatenate(
            [
                rng.normal([x, 0.2, 0.3], noise),
                transforms.from_rpy([0, 0, 0], rng.normal([0.0, 0.0, 1.0], noise / 0.1))[3:] * rng.choice([-1.0, 1.0]),
            ]
        )
        for x in way
    ]


@pytest.mark.parametrize("seed", range(5))
def test_a_body_that_stands_is_found_better_than_it_is_measured(seed):
    poses = measured(np.full(COUNT, 0.5), np.random.default_rng(seed))
    away, angle = transforms.distance(filtered(poses, NOISE), transforms.from_rpy([0.5, 0.2, 0.3], [0, 0, 1.0]))
    assert away < 5.0 * NOISE / np.sqrt(COUNT) and angle < 5.0 * NOISE / 0.1 / np.sqrt(COUNT)


@pytest.mark.parametrize("speed", [0.01, 0.1, 1.0])
def test_a_body_that_moves_is_where_it_was_measured_last(speed):
    poses = measured(np.linspace(0.0, speed, COUNT), np.random.default_rng(0))
    np.testing.assert_array_equal(filtered(poses, NOISE), poses[-1])


def test_few_measurements_and_exact_ones_are_not_averaged():
    poses = measured(np.full(COUNT, 0.5), np.random.default_rng(0))
    assert filtered(poses[: FEWEST - 1], NOISE) is poses[FEWEST - 2]
    assert filtered(poses, 0.0) is poses[-1]


def test_a_jump_is_followed_at_once():
    poses = measured(np.full(COUNT, 0.5), np.random.default_rng(0))
    poses[-1] = poses[-1] + 0.01 * np.eye(7)[0]
    assert filtered(poses, NOISE) is poses[-1]
