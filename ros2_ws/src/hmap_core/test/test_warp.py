"""Changes of pace stay on the path and within the limits, begin without a jump, and stops end at rest."""

import numpy as np
import pytest
from plan_fixtures import drag_plan
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.execution.pace import Pace
from hmap_core.execution.stretches import joint_trajectory, stretches
from hmap_core.execution.warp import HELD_SHARE, PERIOD, SHARE, Warp, constant, curve_of, ramp_to, warped
from hmap_core.simulation.controllers import Outcome, TrajectoryController, from_instant
from hmap_core.types import Goal, JointTrajectory

GOAL = Goal("box", transforms.pose((0.5, 0.05, 0.03)))


@pytest.fixture(scope="module")
def plan():
    return drag_plan(
        scene(box("box", (0.06, 0.06, 0.06), (0.5, -0.05, 0.03)), goal=GOAL), "box", 0.06, np.r_[0, 0.1, 0]
    )


def moving(plan, held: bool):
    """The longest stretch in which the arm moves, with or without the box."""
    (robot,) = plan.scene.robots
    found = [
        s for s in stretches(plan)
        if bool(s.held) == held and np.ptp(joint_trajectory(plan, robot, s).positions, axis=0).max() > 0.05
    ]  # fmt: skip
    return robot, max(found, key=lambda s: s.last - s.first)


def ramp(plan, robot, planned, rate: float, begin: float, share: float, old: Warp | None = None) -> Warp | None:
    limits = {robot: plan.scene.robots[robot].model.acceleration_limits}
    return ramp_to(rate, {robot: planned}, limits, old or Warp(), begin, share)


def off_path(planned: JointTrajectory, motion: JointTrajectory) -> float:
    times = np.linspace(0, planned.times[-1], 20000)
    dense = np.array([np.interp(times, planned.times, q) for q in planned.positions.T])
    return max(np.abs(dense.T - q).max(axis=1).min() for q in motion.positions)


@pytest.mark.parametrize("held", [False, True])
def test_a_stop_stays_on_the_path_within_the_limits(plan, held):
    robot, stretch = moving(plan, held)
    planned, share = joint_trajectory(plan, robot, stretch), HELD_SHARE if held else SHARE
    at = 0.5 * planned.times[-1]
    warp = ramp(plan, robot, planned, 0.0, at, share)
    motion, model = warped(planned, warp), plan.scene.robots[robot].model
    assert at < warp.settled < planned.times[-1] and motion.times[0] == at
    assert not motion.velocities[-1].any() and off_path(planned, motion) < 2e-4
    acceleration = np.diff(motion.velocities, axis=0) / np.diff(motion.times)[:, None]
    own = np.abs(curve_of(planned)(planned.times, 2)).max(axis=0)
    assert (np.abs(acceleration) <= np.maximum(share * model.acceleration_limits, own) + 1e-9).all()


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(("before", "after"), [(1.0, 0.3), (0.3, 1.0), (0.0, 0.5)])
def test_another_pace_stays_on_the_path_and_adds_little_acceleration(plan, held, before, after):
    robot, stretch = moving(plan, held)
    planned, share = joint_trajectory(plan, robot, stretch), HELD_SHARE if held else SHARE
    old = Warp(0.0, 0.4 * planned.times[-1], before, before)
    warp = ramp(plan, robot, planned, after, 0.0, share, old)
    motion, limits = warped(planned, warp), plan.scene.robots[robot].model.acceleration_limits
    assert (np.diff(motion.times) > 0.0).all() and off_path(planned, motion) < 2e-4
    assert motion.positions[-1] == pytest.approx(planned.positions[-1], abs=1e-9)
    assert motion.times[-1] == pytest.approx(warp.clock(planned.times[-1]))
    acceleration = np.diff(motion.velocities, axis=0) / np.diff(motion.times)[:, None]
    assert (np.abs(acceleration) <= (1.0 + share) * limits + 1e-9).all()


def test_a_warp_and_its_inverse_fit():
    for before, after in ((1.0, 0.2), (0.0, 1.0), (0.4, 0.4), (1.0, 0.0)):
        warp = Warp(1.0, 0.5, before, after, 0.6)
        for t in np.linspace(1.0, 1.59, 20):
            assert warp.clock(float(warp.into(t))) == pytest.approx(t, abs=1e-9)
    assert Warp(1.0, 0.5, 1.0, 0.0, 0.6).into(9.0) == pytest.approx(0.8)


def test_at_full_speed_a_motion_is_sent_as_planned(plan):
    robot, stretch = moving(plan, False)
    planned = joint_trajectory(plan, robot, stretch)
    assert warped(planned, constant(1.0)) is planned


def test_where_a_motion_ends_sooner_it_is_followed_to_its_end(plan):
    robot, stretch = moving(plan, False)
    planned = joint_trajectory(plan, robot, stretch)
    assert ramp(plan, robot, planned, 0.0, planned.times[-1] - 0.01, SHARE) is None


@pytest.mark.parametrize("late", [-0.1, PERIOD])
def test_a_controller_takes_a_stop_up_in_the_middle_without_a_jump(plan, late):
    """The stop is told in the time of the motion, and comes ahead of its begin or a little late."""
    robot, stretch = moving(plan, False)
    model, planned = plan.scene.robots[robot].model, joint_trajectory(plan, robot, stretch)
    began, now = 7.0, 7.0 + 0.5 * planned.times[-1]
    whole = warped(planned, ramp(plan, robot, planned, 0.0, now - late - began, SHARE))
    arm = TrajectoryController(model.joint_names, planned.positions[0], model.acceleration_limits)
    arm.start(planned, began)
    told, replaced = [], False
    for t in np.arange(began, now + 2.0, 0.001):
        if not replaced and t >= now:
            arm.start(from_instant(whole, began, t), t)
            replaced = True
        at = arm.update(t, arm.tracking.q, arm.tracking.qd)  # joints that follow ideally
        told += [at.q] if t >= now - 0.05 else []
    assert arm.outcome is Outcome.SUCCEEDED
    speed = np.abs(np.diff(told, axis=0)) / 0.001
    assert speed.max() <= model.velocity_limits.max()
    change = np.abs(np.diff(speed, axis=0)).max() / 0.001
    assert change < 3.0 * model.acceleration_limits.max()
    assert speed[-1].max() == 0.0


@pytest.mark.parametrize("value", [0.0, -0.5, 1.5, float("nan")])
def test_scales_out_of_range_are_refused_and_change_nothing(value):
    pace = Pace(0.5)
    with pytest.raises(InputError, match="speed_scaling = "):
        pace.set_speed(value)
    with pytest.raises(InputError, match="acceleration_scaling = "):
        pace.set_acceleration(value)
    assert pace.rate == 0.5


def test_a_trajectory_of_the_past_is_refused():
    past = JointTrajectory(("a",), np.array([0.0, 1.0]), np.zeros((2, 1)), np.zeros((2, 1)))
    with pytest.raises(InputError, match="ended 1.000 s ago"):
        from_instant(past, 3.0, 5.0)


def test_a_trajectory_of_the_future_is_waited_for():
    later = from_instant(JointTrajectory(("a",), np.array([0.0, 1.0]), np.ones((2, 1)), np.zeros((2, 1))), 5.0, 3.0)
    assert later.times == pytest.approx([2.0, 3.0])
