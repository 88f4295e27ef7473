"""From what controllers say of their joints, it is known where in their motions they are by now."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core.execution.motion_clock import MotionClock
from hmap_core.execution.ports import Feedback
from hmap_core.execution.warp import Warp
from hmap_core.types import JointTrajectory

ROBOT = "panda_1"
DT, COUNT = 0.02, 101
LATE = 100.0  # s of the controller's clock at which it began


@pytest.fixture(scope="module")
def motion() -> JointTrajectory:
    """One joint of an arm moves smoothly for two seconds."""
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(COUNT) / (COUNT - 1))
    q = share[:, None] * np.eye(7)[0]
    return JointTrajectory(tuple("abcdefg"), DT * np.arange(COUNT), q, np.gradient(q, DT, axis=0))


def clock_of(motion, *feedback, now: float = 0.0, warp: Warp | None = None) -> MotionClock:
    commands = {ROBOT: SimpleNamespace(feedback=list(feedback))}
    return MotionClock({ROBOT: motion}, commands, SimpleNamespace(now=lambda: now), warp or Warp())


def report(motion, sample: int, arrived: float, stamp: float = 0.0) -> Feedback:
    return Feedback(arrived, LATE + (stamp or DT * sample), motion.positions[sample])


def test_a_silent_controller_is_at_the_begin(motion):
    clock = clock_of(motion)
    assert clock.into() == 0.0 and clock.start is None and clock.at() is None


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_the_time_goes_on_at_the_rate_of_the_controller(motion, rate):
    arrived = 1000.0
    first, last = report(motion, 10, arrived), report(motion, 40, arrived + 30 * DT / rate)
    clock = clock_of(motion, first, last, now=last.arrived + 0.05)
    assert clock.into() == pytest.approx(40 * DT + 0.05 * rate, abs=1e-3)
    assert clock.start == pytest.approx(LATE, abs=1e-3)
    assert clock.rate == pytest.approx(rate)


def test_slower_motions_are_known_as_well(motion):
    """At half the speed a sample is reached in twice its time."""
    first, last = (report(motion, n, 1000.0 + 2 * DT * n, 2 * DT * n) for n in (10, 40))
    clock = clock_of(motion, first, last, now=last.arrived + 0.05, warp=Warp(before=0.5, after=0.5))
    assert clock.into() == pytest.approx(40 * DT + 0.025, abs=1e-3)
    assert clock.start == pytest.approx(LATE, abs=1e-3)


def test_it_does_not_go_beyond_the_end(motion):
    clock = clock_of(motion, report(motion, COUNT - 2, 1000.0), now=1010.0)
    assert clock.into() == motion.times[-1]
