"""A stop stays on the path and within the limits, begins without a jump, and ends at rest."""

import numpy as np
import pytest
from plan_fixtures import drag_plan
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.execution.halt import HELD_SHARE, SHARE, halt
from hmap_core.execution.stretches import joint_trajectory, stretches
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


@pytest.mark.parametrize("held", [False, True])
def test_a_stop_stays_on_the_path_within_the_limits(plan, held):
    robot, stretch = moving(plan, held)
    time = plan.trajectory.time
    at = 0.5 * (time[stretch.first] + time[stretch.last])
    stop = halt(plan, stretch, at)
    motion, model = stop.motions[robot], plan.scene.robots[robot].model
    assert at < stop.rests < time[stretch.last]
    assert not motion.velocities[-1].any()
    planned = joint_trajectory(plan, robot, stretch)
    dense = np.array(
        [np.interp(np.linspace(0, planned.times[-1], 20000), planned.times, q) for q in planned.positions.T]
    )
    off = [np.abs(dense.T - q).max(axis=1).min() for q in motion.positions]
    assert max(off) < 2e-4
    acceleration = np.diff(motion.velocities, axis=0) / np.diff(motion.times)[:, None]
    assert (np.abs(acceleration) <= (HELD_SHARE if held else SHARE) * model.acceleration_limits + 1e-9).all()


def test_where_the_stretch_ends_sooner_it_is_followed_to_its_end(plan):
    robot, stretch = moving(plan, False)
    end = plan.trajectory.time[stretch.last]
    stop = halt(plan, stretch, end - 0.01)
    assert stop.rests == end
    assert stop.motions[robot].positions[-1] == pytest.approx(plan.trajectory.joints[robot][stretch.last], abs=1e-9)


def test_a_controller_takes_a_stop_up_in_the_middle_without_a_jump(plan):
    """The new trajectory is told in the time of the old one, and comes a little late."""
    robot, stretch = moving(plan, False)
    model, planned = plan.scene.robots[robot].model, joint_trajectory(plan, robot, stretch)
    began, now = 7.0, 7.0 + 0.5 * planned.times[-1]
    stop = halt(plan, stretch, plan.trajectory.time[stretch.first] + now + 0.1 - began)
    ahead = planned.times < stop.motions[robot].times[0] - 1e-6
    whole = JointTrajectory(
        model.joint_names,
        np.r_[planned.times[ahead], stop.motions[robot].times],
        np.r_[planned.positions[ahead], stop.motions[robot].positions],
        np.r_[planned.velocities[ahead], stop.motions[robot].velocities],
    )
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


def test_a_trajectory_of_the_past_is_refused():
    past = JointTrajectory(("a",), np.array([0.0, 1.0]), np.zeros((2, 1)), np.zeros((2, 1)))
    with pytest.raises(InputError, match="ended 1.000 s ago"):
        from_instant(past, 3.0, 5.0)


def test_a_trajectory_of_the_future_is_waited_for():
    later = from_instant(JointTrajectory(("a",), np.array([0.0, 1.0]), np.ones((2, 1)), np.zeros((2, 1))), 5.0, 3.0)
    assert later.times == pytest.approx([2.0, 3.0])
