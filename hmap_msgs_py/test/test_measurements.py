"""Stamps are judged both ways, older measurements replace nothing, and a clock may jump back."""

import math

import pytest

from hmap_msgs_py.measurements import Latest, ReceiverClock, StampError

AHEAD = 1.0  # s
HOUR = 3600.0  # s


class Clock:
    """A clock that a test sets."""

    def __init__(self, now: float | None):
        self.now = now

    def __call__(self) -> float | None:
        return self.now


@pytest.fixture
def time():
    return Clock(100.0)


@pytest.fixture
def latest(time):
    return Latest("the pose of 'cup'", ReceiverClock(time, AHEAD))


def test_newest_stamp_counts_not_the_last_to_arrive(latest):
    assert latest.add(99.0, "new")
    assert not latest.add(98.0, "old")
    assert latest.newest() == (99.0, "new")
    assert latest.add(99.0, "same stamp") and latest.newest() == (99.0, "same stamp")


@pytest.mark.parametrize("stamp", [100.0 + HOUR, 100.0 + 1.1 * AHEAD, math.nan, math.inf])
def test_stamp_that_cannot_be_right_is_refused_and_named(latest, stamp):
    latest.add(99.5, "good")
    with pytest.raises(StampError, match="pose of 'cup'"):
        latest.add(stamp, "bad")
    assert latest.newest() == (99.5, "good")
    assert latest.add(100.0 + 0.9 * AHEAD, "a little ahead")


def test_clock_that_jumps_back_drops_what_was_measured_before(latest, time):
    latest.add(99.0, "before")
    time.now = 0.2
    assert latest.add(0.1, "after")
    assert latest.newest() == (0.1, "after")


def test_small_step_of_the_clock_back_recovers_as_well(latest, time):
    latest.add(99.9, "before")  # a step that is smaller than what a stamp may be ahead
    time.now = 99.5
    assert latest.add(99.4, "after") and latest.newest() == (99.4, "after")


def test_measurement_that_arrives_before_the_news_of_the_restart_is_not_lost(latest, time):
    latest.add(99.0, "before")
    assert not latest.add(0.1, "after")  # the clock says 100 s still
    time.now = 0.1
    latest._clock.now()
    assert latest.newest() == (0.1, "after")


def test_what_was_taken_before_the_clock_is_known_is_judged_once_it_is(latest, time):
    time.now = None
    assert latest.add(100.0 + HOUR, "ahead") and latest.newest() is not None
    time.now = 100.0
    latest._clock.now()
    assert latest.newest() is None
    assert latest.add(99.0, "good") and latest.newest() == (99.0, "good")


def test_without_a_clock_stamps_are_only_compared():
    latest = Latest("x")
    assert latest.add(HOUR, 1) and not latest.add(0.0, 2) and latest.newest() == (HOUR, 1)


def test_late_measurements_are_found_by_their_time(time):
    latest = Latest("x", ReceiverClock(time, AHEAD), kept=3)
    for stamp in (1.0, 4.0, 2.0, 5.0):
        latest.add(stamp, stamp)
    assert [latest.nearest(stamp) for stamp in (0.0, 2.2, 4.4, 9.0)] == [2.0, 2.0, 4.0, 5.0]  # three are kept
    assert latest.newest() == (5.0, 5.0)
