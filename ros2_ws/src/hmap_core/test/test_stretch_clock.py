"""From what controllers say of their joints, it is known where in a stretch they are by now."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core.execution.ports import Feedback
from hmap_core.execution.stretch_clock import StretchClock
from hmap_core.execution.stretches import Stretch
from hmap_core.scenes import load_scene
from hmap_core.types import Plan, Trajectory

ROBOT = "panda_1"
BEGAN = 5.0  # planned s at which the stretch begins
DT, COUNT = 0.02, 101
LATE = 100.0  # s of the controller's clock at which it began


@pytest.fixture(scope="module")
def plan():
    """One joint of one arm moves smoothly for two seconds."""
    scene = load_scene("tunnel", 0)
    time = BEGAN + DT * np.arange(COUNT)
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(COUNT) / (COUNT - 1))
    joints = {name: np.repeat(robot.q[None], COUNT, 0) for name, robot in scene.robots.items()}
    joints[ROBOT] = joints[ROBOT] + share[:, None] * np.eye(7)[0]
    return Plan(scene, Trajectory(time, joints, {}, {}), (), np.zeros((0, 7)), {})


def stretch_clock(plan, *feedback, now: float = 0.0) -> StretchClock:
    stretch = Stretch(0, COUNT - 1, {}, "", (), True, True)
    return StretchClock(
        plan, stretch, {ROBOT: SimpleNamespace(feedback=list(feedback))}, SimpleNamespace(now=lambda: now)
    )


def report(plan, sample: int, arrived: float) -> Feedback:
    return Feedback(arrived, LATE + DT * sample, plan.trajectory.joints[ROBOT][sample])


def test_a_silent_controller_is_at_the_begin(plan):
    clock = stretch_clock(plan)
    assert clock.now() == BEGAN and clock.start is None


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_the_time_goes_on_at_the_rate_of_the_controller(plan, rate):
    arrived = 1000.0
    first, last = report(plan, 10, arrived), report(plan, 40, arrived + 30 * DT / rate)
    clock = stretch_clock(plan, first, last, now=last.arrived + 0.05)
    assert clock.now() == pytest.approx(BEGAN + 40 * DT + 0.05 * rate, abs=1e-3)
    assert clock.start == pytest.approx(LATE, abs=1e-3)
    assert clock.rate == pytest.approx(rate)


def test_it_does_not_go_beyond_the_end(plan):
    clock = stretch_clock(plan, report(plan, COUNT - 2, 1000.0), now=1010.0)
    assert clock.now() == plan.trajectory.time[-1]
