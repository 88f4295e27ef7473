"""Timing of joint paths: limits, end points, geometry, sampling grid, wrong input."""

import numpy as np
import pytest

from hmap_core.exceptions import MotionError
from hmap_core.trajectory.timing import PointLimits, distinct_points, spline, time_parameterise

VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
DT = 0.02


def wandering(rng: np.random.Generator, points: int, step: float) -> np.ndarray:
    return rng.uniform(-1, 1, 7) + np.cumsum(rng.normal(0, step, (points, 7)), axis=0)


def random_paths():
    rng = np.random.default_rng(7)
    yield from (rng.uniform(-2, 2, (m, 7)) for m in (2, 3, 8, 40))
    yield from (wandering(rng, m, step) for m in (2, 3, 10, 30) for step in (1e-7, 1e-5, 1e-3, 0.03, 0.3))


@pytest.mark.parametrize("path", list(random_paths()))
def test_samples_respect_the_limits_even_between_resting_neighbours(path):
    timed = time_parameterise(path, VELOCITY, ACCELERATION, DT)
    joined = np.concatenate([timed.q[:1], timed.q, timed.q[-1:]])
    assert (np.abs(np.diff(joined, axis=0)) / DT <= VELOCITY * (1 + 1e-9)).all()
    assert (np.abs(np.diff(joined, 2, axis=0)) / DT**2 <= ACCELERATION * (1 + 1e-9)).all()
    assert (np.abs(timed.qd) <= VELOCITY * (1 + 1e-9)).all()


@pytest.mark.parametrize("path", list(random_paths()))
def test_ends_are_exact_and_at_rest_and_the_grid_is_uniform(path):
    timed = time_parameterise(path, VELOCITY, ACCELERATION, DT)
    assert np.array_equal(timed.q[0], path[0]) and np.array_equal(timed.q[-1], path[-1])
    assert not timed.qd[0].any() and not timed.qd[-1].any()
    assert timed.time == pytest.approx(np.arange(len(timed.time)) * DT)
    assert timed.q.shape == timed.qd.shape == (len(timed.time), 7)


def test_samples_lie_on_the_spline_in_order():
    path = wandering(np.random.default_rng(1), 20, 0.1)
    timed, curve = time_parameterise(path, VELOCITY, ACCELERATION, DT), spline(path)
    dense = np.linspace(0.0, curve.x[-1], 8001)
    distance = np.linalg.norm(timed.q[:, None] - curve(dense)[None], axis=2)
    assert distance.min(axis=1).max() < 5e-4  # half the spacing of the dense points
    assert (np.diff(dense[distance.argmin(axis=1)]) >= 0).all()


def test_spline_passes_through_the_points():
    path = wandering(np.random.default_rng(2), 12, 0.1)
    curve = spline(path)
    assert np.allclose(curve(curve.x), path, atol=1e-12)


def test_a_straight_line_is_as_fast_as_the_limits_allow():
    # 1 rad at 2 rad/s and 10 rad/s^2, from rest to rest: distance / v + v / a
    timed = time_parameterise([[0.0], [1.0]], np.array([2.0]), np.array([10.0]), 0.001)
    assert 0.7 <= timed.duration < 0.72


def test_velocities_are_the_derivative_of_the_positions():
    path = wandering(np.random.default_rng(3), 15, 0.2)
    timed = time_parameterise(path, VELOCITY, ACCELERATION, 0.001)
    numeric = (timed.q[2:] - timed.q[:-2]) / 0.002
    assert np.abs(numeric - timed.qd[1:-1]).max() < 0.001 * ACCELERATION.max()


@pytest.mark.parametrize("path", [[[0.3, 0.1]], [[0.3, 0.1]] * 5, [[0.3, 0.1], [0.3 + 1e-9, 0.1], [0.3, 0.1]]])
def test_a_path_that_goes_nowhere_is_one_sample(path):
    timed = time_parameterise(path, np.ones(2), np.ones(2), DT)
    assert timed.time.tolist() == [0.0] and timed.duration == 0.0
    assert np.array_equal(timed.q, [[0.3, 0.1]]) and not timed.qd.any()


def test_repeated_points_do_not_stop_the_motion():
    path = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])
    repeated = np.repeat(path, 3, axis=0)
    once = time_parameterise(path, np.ones(2), np.ones(2), DT)
    again = time_parameterise(repeated, np.ones(2), np.ones(2), DT)
    assert np.allclose(once.q, again.q)


def test_distinct_points_keep_the_ends():
    path = np.array([[0.0], [1e-9], [1.0], [1.0 + 1e-9]])
    assert distinct_points(path).ravel().tolist() == [0.0, 1.0 + 1e-9]
    assert distinct_points(path[:2]).ravel().tolist() == [0.0, 1e-9]


@pytest.mark.parametrize(
    "path, velocity, acceleration, dt, word",
    [
        ([[0.0, np.nan], [1.0, 1.0]], [1, 1], [1, 1], DT, "finite"),
        (np.zeros((0, 2)), [1, 1], [1, 1], DT, "shape"),
        ([0.0, 1.0], [1, 1], [1, 1], DT, "shape"),
        ([[0.0, 0.0], [1.0, 1.0]], [1, 0], [1, 1], DT, "velocity"),
        ([[0.0, 0.0], [1.0, 1.0]], [1, 1], [1], DT, "acceleration"),
        ([[0.0, 0.0], [1.0, 1.0]], [1, 1], [1, 1], 0.0, "period"),
    ],
)
def test_wrong_input_names_what_is_wrong(path, velocity, acceleration, dt, word):
    with pytest.raises(MotionError, match=word):
        time_parameterise(path, velocity, acceleration, dt)


POSITION = np.array([-np.ones(7), np.ones(7)])


@pytest.mark.parametrize("seed", range(30))
def test_position_limits_are_kept_between_the_points_with_all_other_limits(seed):
    rng = np.random.default_rng(seed)
    path = np.clip(1.4 * rng.uniform(-1.0, 1.0, (rng.integers(3, 12), 7)), *POSITION)
    free = time_parameterise(path, VELOCITY, ACCELERATION, DT)
    timed = time_parameterise(path, VELOCITY, ACCELERATION, DT, POSITION)
    assert np.abs(free.q).max() > 1.0 and np.abs(timed.q).max() <= 1.0
    joined = np.concatenate([timed.q[:1], timed.q, timed.q[-1:]])
    assert (np.abs(np.diff(joined, axis=0)) / DT <= VELOCITY * (1 + 1e-9)).all()
    assert (np.abs(np.diff(joined, 2, axis=0)) / DT**2 <= ACCELERATION * (1 + 1e-9)).all()
    assert np.array_equal(timed.q[0], path[0]) and np.array_equal(timed.q[-1], path[-1])


def test_points_beyond_a_position_limit_are_moved_onto_it_or_refused():
    path = np.zeros((3, 7))
    path[:, 0], path[1, 2] = (0.0, 0.5, 1.0), -1.0 - 5e-4
    assert time_parameterise(path, VELOCITY, ACCELERATION, DT, POSITION).q.min() >= -1.0
    path[1, 2] = -1.002
    with pytest.raises(MotionError, match="point 1 of the path has joint 3 at -1.0020; allowed: -1.0000 to 1.0000"):
        time_parameterise(path, VELOCITY, ACCELERATION, DT, POSITION)


def turning(q: np.ndarray) -> np.ndarray:
    """Positions of a point 0.7 m from the first joint's axis, which sways with the second joint."""
    return np.stack([0.7 * np.cos(q[:, 0]), 0.7 * np.sin(q[:, 0]), 0.2 * q[:, 1]], axis=1)


@pytest.mark.parametrize(("speed", "acceleration"), [(0.3, 5.0), (5.0, 0.4), (0.2, 0.5)])
def test_a_carried_point_keeps_its_limits_and_no_more_than_that_is_given_away(speed, acceleration):
    path = np.stack([np.linspace(0.0, 2.0, 12), 0.3 * np.sin(np.linspace(0.0, 3.0, 12))], axis=1)
    limits = np.full(2, 3.0), np.full(2, 20.0)
    free = time_parameterise(path, *limits, 0.01)
    timed = time_parameterise(path, *limits, 0.01, carried=PointLimits(turning, speed, acceleration))
    points = turning(timed.q)
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / 0.01
    accelerations = np.linalg.norm(np.diff(points, 2, axis=0), axis=1) / 0.01**2
    assert speeds.max() <= 1.001 * speed and accelerations.max() <= 1.03 * acceleration
    assert speeds.max() > 0.98 * speed or accelerations.max() > 0.75 * acceleration
    assert timed.duration > free.duration


def test_a_carried_point_that_stands_still_takes_no_time():
    path = np.array([[0.0, 0.0], [1.0, 0.5]])
    limits = np.full(2, 2.0), np.full(2, 5.0)
    still = PointLimits(lambda q: np.zeros((len(q), 3)), 0.1, 0.1)
    assert np.array_equal(time_parameterise(path, *limits, DT).q, time_parameterise(path, *limits, DT, None, still).q)
