"""Trajectory and gripper controllers, against joints that follow ideally, late, or not at all."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import panda_model

from hmap_core.exceptions import InputError
from hmap_core.simulation.controllers import STALL_TIME, GripperController, Outcome, Tolerances, TrajectoryController
from hmap_core.trajectory.timing import time_parameterise
from hmap_core.types import JointTrajectory

NAMES = ("a", "b")
ACCELERATION = np.array([4.0, 8.0])
DT = 0.004
HERE = np.array([0.1, -0.2])


def controller(**tolerances) -> TrajectoryController:
    return TrajectoryController(NAMES, HERE, ACCELERATION, Tolerances(**tolerances))


def trajectory(**changes) -> JointTrajectory:
    timed = time_parameterise([HERE, [0.6, 0.5], [1.0, -0.5]], np.array([1.0, 2.0]), ACCELERATION, 0.02)
    return replace(JointTrajectory(NAMES, timed.time, timed.q, timed.qd), **changes)


def run(arm: TrajectoryController, until: float, now: float = 0.0, share: float = 1.0) -> np.ndarray:
    """Desired positions (N, 2) at each step up to a time; the joints cover ``share`` of every desired displacement."""
    q, desired = arm.tracking.q_actual, []
    while now < until - 1e-9:
        qd = np.zeros(2) if share == 0.0 else arm.tracking.qd
        tracking = arm.update(now, q, qd)
        q = q + share * (tracking.q - q)
        desired.append(tracking.q)
        now += DT
    return np.array(desired)


def test_follows_the_points_and_succeeds_at_rest():
    arm, motion = controller(), trajectory()
    arm.start(motion, 0.0)
    for t, q, qd in zip(motion.times, motion.positions, motion.velocities, strict=True):
        tracking = arm.update(t, q, qd)
        assert tracking.q == pytest.approx(q, abs=1e-9) and tracking.qd == pytest.approx(qd, abs=1e-9)
        assert arm.active == (t < motion.times[-1])
    assert arm.outcome is Outcome.SUCCEEDED and not arm.moving


def test_between_far_apart_points_the_velocity_is_the_derivative_of_the_position():
    arm = controller(path=10.0)
    positions = [HERE, HERE + [0.5, -0.3], HERE + [0.2, 0.4]]
    arm.start(JointTrajectory(NAMES, [0.0, 0.5, 1.2], positions, [[0.0, 0.3], [-0.8, 0.5], [0.0, 0.0]]), 0.0)
    states = [arm.update(t, HERE, np.zeros(2)) for t in np.arange(0.0, 1.2, 1e-3)]
    q, qd = np.array([s.q for s in states]), np.array([s.qd for s in states])
    assert (q[2:] - q[:-2]) / 2e-3 == pytest.approx(qd[1:-1], abs=0.005)
    assert np.abs(np.diff(qd, axis=0)).max() < 0.02


def test_columns_are_matched_by_name():
    motion = trajectory()
    swapped = JointTrajectory(("b", "a"), motion.times, motion.positions[:, ::-1], motion.velocities[:, ::-1])
    one, two = controller(), controller()
    one.start(motion, 0.0)
    two.start(swapped, 0.0)
    assert np.array_equal(run(one, 0.5), run(two, 0.5))


def test_without_velocities_it_goes_straight_between_the_points():
    arm = controller(path=10.0)
    arm.start(JointTrajectory(NAMES, [0.0, 1.0], [HERE, HERE + [1.0, 2.0]]), 5.0)
    tracking = arm.update(5.25, HERE, np.zeros(2))
    assert tracking.q == pytest.approx(HERE + [0.25, 0.5]) and tracking.qd == pytest.approx([1.0, 2.0])


def test_a_late_first_point_is_reached_from_where_the_joints_are():
    arm = controller()
    arm.start(JointTrajectory(NAMES, [2.0], [[1.0, 1.0]], [[0.0, 0.0]]), 0.0)
    desired = run(arm, 2.1)
    assert desired[0] == pytest.approx(HERE) and desired[-1] == pytest.approx([1.0, 1.0])
    assert np.abs(np.diff(desired, axis=0)).max() < 0.01


def test_a_blocked_joint_aborts_naming_it_and_the_command_stops_where_it_is():
    arm = controller(path=0.1)
    arm.start(trajectory(), 0.0)
    desired = run(arm, 3.0, share=0.0)
    assert arm.outcome is Outcome.PATH_TOLERANCE_VIOLATED
    assert "joint" in arm.reason and "0.100 is allowed" in arm.reason
    assert desired[-1] == pytest.approx(HERE) and not arm.moving


def test_not_arriving_in_time_aborts():
    arm, motion = controller(path=10.0, goal=0.01, goal_time=0.5), trajectory()
    arm.start(motion, 0.0)
    run(arm, motion.times[-1] + 0.4, share=0.0)
    assert arm.active
    run(arm, motion.times[-1] + 0.7, now=motion.times[-1] + 0.4, share=0.0)
    assert arm.outcome is Outcome.GOAL_TOLERANCE_VIOLATED and "joint" in arm.reason


def test_arriving_late_within_the_time_succeeds():
    arm, motion = controller(path=10.0, goal=0.01, goal_time=0.5), trajectory()
    arm.start(motion, 0.0)
    run(arm, motion.times[-1], share=0.02)
    assert arm.active and np.abs(arm.tracking.error).max() > 0.01
    run(arm, motion.times[-1] + 0.4, now=motion.times[-1], share=0.5)
    assert arm.outcome is Outcome.SUCCEEDED


@pytest.mark.parametrize("when", [0.1, 0.4, 0.7])
def test_cancel_comes_to_rest_within_the_acceleration_limits(when):
    arm = controller()
    arm.start(trajectory(), 0.0)
    before = run(arm, when)
    speed = np.abs(arm.tracking.qd).max()
    arm.cancel(when)
    assert arm.outcome is Outcome.CANCELED and not arm.active
    after = run(arm, when + 1.0, now=when)
    joined = np.concatenate([before[-2:], after])
    assert speed > 0.1 and not arm.moving and np.array_equal(after[-1], after[-2])
    acceleration = np.abs(np.diff(joined, 2, axis=0))[1:] / DT**2
    assert (acceleration <= ACCELERATION * 1.05).all()


def test_cancel_when_idle_changes_nothing():
    arm = controller()
    arm.cancel(1.0)
    assert arm.outcome is None and np.array_equal(arm.update(1.1, HERE, np.zeros(2)).q, HERE)


def test_a_new_trajectory_takes_over_from_the_desired_state():
    arm, motion = controller(), trajectory()
    arm.start(motion, 0.0)
    run(arm, 0.4)
    q, qd = arm.tracking.q, arm.tracking.qd
    arm.start(JointTrajectory(NAMES, [0.0, 1.0], [q, [1.0, 0.0]], [qd, [0.0, 0.0]]), 0.4 - DT)
    assert arm.active
    run(arm, 1.5, now=0.4 - DT)
    assert arm.outcome is Outcome.SUCCEEDED and arm.tracking.q == pytest.approx([1.0, 0.0])


def with_value(table: np.ndarray, row: int, value: float) -> np.ndarray:
    table = np.array(table)
    table[row] = value
    return table


@pytest.mark.parametrize(
    "changes, word",
    [
        (lambda m: {"positions": with_value(m.positions, 3, np.nan)}, "positions.*point 3"),
        (lambda m: {"velocities": with_value(m.velocities, 4, np.inf)}, "velocities.*point 4"),
        (lambda m: {"times": with_value(m.times, 2, np.nan)}, "times.*point 2"),
        (lambda m: {"times": with_value(m.times, 2, m.times[1])}, "increase.*point 2"),
        (lambda m: {"times": m.times - 1.0}, "increase.*point 0"),
        (lambda m: {"names": ("a", "elbow")}, "unknown: .'elbow'.*missing: .'b'"),
        (lambda m: {"names": ("a",), "positions": m.positions[:, :1]}, "missing: .'b'"),
        (lambda m: {"names": ("a", "a")}, "missing: .'b'"),
        (lambda m: {"positions": m.positions[:-1]}, "shape"),
        (lambda m: {"velocities": m.velocities[:, :1]}, "shape"),
        (lambda m: {"times": [], "positions": np.zeros((0, 2)), "velocities": None}, "no points"),
        (lambda m: {"positions": m.positions + 0.3}, "starts 0.300 rad"),
        (lambda m: {"velocities": with_value(m.velocities, -1, 4e-7)}, "end at rest"),
    ],
)
def test_bad_trajectories_are_rejected_and_the_active_one_goes_on(changes, word):
    arm, motion = controller(), trajectory()
    with pytest.raises(InputError, match=word):
        arm.start(replace(motion, **changes(motion)), 0.0)
    assert arm.outcome is None
    arm.start(motion, 0.0)
    with pytest.raises(InputError, match=word):
        arm.start(replace(motion, **changes(motion)), 0.0)
    run(arm, motion.times[-1] + 0.1)
    assert arm.outcome is Outcome.SUCCEEDED


def gripper() -> GripperController:
    return GripperController(panda_model().gripper, 0.08)


def test_gripper_reaches_its_opening_and_goes_on_pressing():
    hand = gripper()
    hand.start(0.02, 15.0)
    assert hand.update(0.0, 0.08, 0.0) == (0.02, 15.0) and hand.active
    hand.update(0.1, 0.05, -0.1)
    assert hand.active
    hand.update(0.2, 0.0204, -0.1)
    assert hand.outcome is Outcome.SUCCEEDED and hand.result.reached and not hand.result.stalled
    assert hand.update(9.0, 0.0204, 0.0) == (0.02, 15.0)


def test_gripper_stalls_on_what_it_holds():
    hand = gripper()
    hand.start(0.0)
    hand.update(0.0, 0.08, -0.1)
    hand.update(0.3, 0.06, 0.0, 40.0)
    assert hand.active
    opening, force = hand.update(0.3 + STALL_TIME, 0.06, 0.0, 40.0)
    assert hand.outcome is Outcome.STALLED and hand.result.stalled and not hand.result.reached
    assert hand.result.effort == 40.0 and (opening, force) == (0.0, panda_model().gripper.force)


def test_a_gripper_whose_fingers_tremble_stalls_and_one_that_moves_does_not():
    step, count = 0.01, int(STALL_TIME / 0.01) + 2
    trembling, moving = gripper(), gripper()
    for hand in (trembling, moving):
        hand.start(0.0)
    for k in range(count):
        trembling.update(k * step, 0.06 + 5e-5 * (k % 2), 0.01 * (k % 2))
        moving.update(k * step, 0.06 - 1e-4 * k, -0.01)
    assert trembling.outcome is Outcome.STALLED
    assert moving.active


def test_canceled_gripper_stays_where_it_is():
    hand = gripper()
    hand.start(0.0)
    hand.update(0.1, 0.05, -0.1)
    hand.cancel()
    assert hand.outcome is Outcome.CANCELED and hand.update(0.2, 0.05, 0.0)[0] == 0.05


@pytest.mark.parametrize("opening, effort", [(np.nan, 1.0), (0.2, 1.0), (-0.1, 1.0), (0.0, np.nan), (0.0, -1.0)])
def test_bad_gripper_commands_are_rejected(opening, effort):
    hand = gripper()
    with pytest.raises(InputError, match="gripper"):
        hand.start(opening, effort)
    assert hand.outcome is None


def test_at_rest_a_trajectory_may_start_where_the_joints_are_and_not_only_where_they_are_told_to_be():
    arm = controller()
    pushed = HERE + [0.0, 0.04]
    arm.update(0.0, pushed, np.zeros(2))
    arm.start(JointTrajectory(NAMES, [0.0, 1.0], [pushed, HERE + [1.0, 2.0]]), 0.0)
    assert arm.active
