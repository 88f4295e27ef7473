"""A body in the way of a plan: conflicts are found, how far it is still good, and how a hand lets go."""

from dataclasses import replace

import numpy as np
import pytest
from replan_fixtures import FAR, RADIUS, brick_plan, hand

from hmap_core.kinematics.arm import load_arm
from hmap_core.plan_file import to_dict
from hmap_core.planner.conflicts import Conflict, first_conflict, unknown_bodies
from hmap_core.planner.interruption import (
    back_to,
    clear_sample,
    contact_at,
    contacts,
    good_until,
    held_pose,
    release,
    stable_sample,
)
from hmap_core.planner.repair import plan_anew
from hmap_core.simulation.dynamic import sphere
from hmap_core.trajectory.samples import state_at
from hmap_core.transforms import apply
from hmap_core.validation import check


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return brick_plan(tmp_path_factory)


def test_a_body_far_away_is_no_conflict(plan):
    assert first_conflict(plan, {"ball": FAR}) is None
    assert first_conflict(plan, {}) is None


def test_a_body_where_the_hand_comes_by_is_found_in_time(plan):
    made = contacts(plan)[0]
    k = made.begin // 2
    conflict = first_conflict(plan, {"ball": sphere("ball", RADIUS, hand(plan, k))})
    assert conflict.body == "ball" and conflict.what.startswith("arm/")
    assert 0.0 <= conflict.time <= plan.trajectory.time[k]
    after = plan.trajectory.time[made.begin]
    later = first_conflict(plan, {"ball": sphere("ball", RADIUS, hand(plan, k))}, after)
    assert later is None or later.time >= after


def test_a_body_on_the_way_of_the_object_is_found(plan):
    low = np.array([*plan.trajectory.objects["brick"][-1][:2], 0.01])
    conflict = first_conflict(plan, {"pin": sphere("pin", 0.005, low)})
    assert (conflict.what, conflict.body) == ("brick", "pin")


def test_what_a_plan_does_not_know(plan):
    same = unknown_bodies(plan, plan.scene.bodies)
    table = plan.scene.bodies["table"]
    moved = replace(table, pose=table.pose + np.eye(7)[2] * 0.01)
    assert not same
    assert set(unknown_bodies(plan, plan.scene.bodies | {"ball": FAR, "table": moved})) == {"ball", "table"}


def test_a_plan_is_good_up_to_the_last_free_hand_before_a_conflict(plan):
    time, made = plan.trajectory.time, contacts(plan)[0]
    end = float(time[made.last])
    assert good_until(plan, 0.0, Conflict(end + 1.0, "arm/hand", "ball")) == end
    assert good_until(plan, 0.0, Conflict(end - 1.0, "arm/hand", "ball")) is None
    assert good_until(plan, end, Conflict(end + 1.0, "arm/hand", "ball")) is None


def test_a_hand_that_stops_while_it_carries_lets_go(plan):
    time, made = plan.trajectory.time, contacts(plan)[0]
    k = (made.begin + made.end) // 2
    assert contact_at(plan, time[k]) == made
    assert stable_sample(plan, made, time[k]) == k  # it slides on the table
    state = state_at(plan, k)
    assert held_pose(plan.scene, state, made) == pytest.approx(state.poses["brick"], abs=1e-4)
    opening, motion = release(plan.scene, state, plan, made)
    assert opening > state.gripper["arm"]
    np.testing.assert_array_equal(motion.positions[0], state.q["arm"])


@pytest.mark.parametrize(
    ("place", "back"),
    [((0.09, 0.0, -0.12), 0.1), ((0.015, -0.098, -0.203), 0.05), ((-0.004, 0.117, -0.066), 0.0)],
    ids=["all the way", "some of it", "nowhere"],
)
def test_a_hand_draws_back_as_far_as_there_is_room_and_goes_on_from_there(plan, place, back):
    """A ball stands in a place (3,) of the hand's own frame where it lets go, beside or behind it."""
    made, arm = contacts(plan)[0], load_arm(plan.scene.robots["arm"].model)
    k = (made.begin + made.end) // 2
    state = state_at(plan, k)
    T_ee = arm.end_effector(state.q["arm"])
    ball = sphere("ball", 0.015, apply(T_ee, np.array(place)))
    scene = replace(plan.scene, bodies=plan.scene.bodies | {"ball": ball})
    state.poses["ball"] = ball.pose
    state.gripper["arm"], motion = release(scene, state, plan, made)
    assert (motion is None) == (back == 0.0)
    if motion is not None:
        state.q["arm"] = motion.positions[-1].copy()
        moved = np.linalg.norm(arm.end_effector(state.q["arm"])[:3] - T_ee[:3])
        assert moved == pytest.approx(back, abs=1e-3)
    new, _ = plan_anew(plan, float(plan.trajectory.time[k]), scene, state, 1)
    assert check(to_dict(new)).valid


def test_a_hand_round_the_object_goes_back_as_it_came(plan):
    made = contacts(plan)[0]
    at = float(plan.trajectory.time[made.begin])
    sample = clear_sample(plan, made, at)
    assert made.first < sample < made.begin
    assert np.linalg.norm(hand(plan, sample) - hand(plan, made.begin)) > 0.09
    q = plan.trajectory.joints["arm"]
    motion = back_to(plan, ("arm",), sample, {"arm": q[made.begin]}, at)["arm"]
    assert motion.positions[-1] == pytest.approx(q[sample])
    assert back_to(plan, ("arm",), made.first, {"arm": q[made.first]}, float(plan.trajectory.time[made.first])) == {}
