"""Planning anew in the middle of a plan: conflicts are found, what is good is kept, and the new plan is valid."""

from dataclasses import replace

import numpy as np
import pytest
from replan_fixtures import FAR, RADIUS, brick_plan, hand, on_the_way_to_the_contact, with_body

from hmap_core import planner, transforms
from hmap_core.exceptions import Code, ContactError
from hmap_core.plan_file import to_dict
from hmap_core.planner import LocalBackend
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
    state_at,
)
from hmap_core.planner.replan import KeepingBackend
from hmap_core.simulation.dynamic import sphere
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


def test_with_nothing_in_the_way_the_whole_plan_is_kept(plan):
    scene = with_body(plan, FAR)
    state = state_at(plan, 0)
    state.poses["ball"] = FAR.pose
    backend = KeepingBackend(LocalBackend(), plan, scene.bodies, 0.0)
    new = planner.plan(scene, state=state, backend=backend)
    assert backend.kept == {"paths": 1, "contacts": len(contacts(plan)), "motions": len(contacts(plan))}
    assert np.allclose(new.trajectory.joints["arm"], plan.trajectory.joints["arm"])


def test_a_blocked_transit_is_planned_anew_for_the_kept_contact(plan):
    body = on_the_way_to_the_contact(plan)
    scene, state = with_body(plan, body), state_at(plan, 0)
    state.poses["ball"] = body.pose
    backend = KeepingBackend(LocalBackend(), plan, scene.bodies, 0.0)
    new = planner.plan(scene, state=state, backend=backend)
    assert backend.kept["paths"] == 1 and backend.kept["contacts"] >= 1 and backend.kept["motions"] == 0
    assert check(to_dict(new)).valid


def test_a_hand_that_stops_while_it_carries_lets_go_and_plans_on(plan):
    time, made = plan.trajectory.time, contacts(plan)[0]
    k = (made.begin + made.end) // 2
    assert contact_at(plan, time[k]) == made
    assert stable_sample(plan, made, time[k]) == k  # it slides on the table
    state = state_at(plan, k)
    assert held_pose(plan.scene, state, made) == pytest.approx(state.poses["brick"], abs=1e-4)
    opening, motion = release(plan.scene, state, plan, made)
    assert opening > state.gripper["arm"]
    state.q["arm"], state.gripper["arm"] = motion.positions[-1], opening
    backend = KeepingBackend(LocalBackend(), plan, plan.scene.bodies, float(time[k]))
    new = planner.plan(plan.scene, state=state, backend=backend)
    assert backend.kept["paths"] == 1 and backend.kept["contacts"] >= 1
    assert check(to_dict(new)).valid


class OnlyChecks(LocalBackend):
    """Checks contacts, and cannot look for others."""

    def propose_contacts(self, *request):
        raise ContactError("nothing is looked for", Code.NO_CONTACT)


@pytest.mark.parametrize(("length", "kept"), [(0.1, 1), (2.0, 0)])
def test_on_another_path_the_old_contact_is_taken_up_where_it_serves(plan, length, kept):
    made = contacts(plan)[0]
    k = (made.begin + made.end) // 2
    state = state_at(plan, k)
    state.q["arm"] = plan.scene.robots["arm"].model.home.copy()
    start = state.poses["brick"]
    poses = transforms.interpolate(start, start + np.eye(7)[0] * length, np.linspace(0.0, 1.0, 21))
    backend = KeepingBackend(OnlyChecks(), plan, plan.scene.bodies, float(plan.trajectory.time[k]))
    request = plan.scene, state, "brick", poses, ("arm",), None, 10, 0, 10.0
    if kept:
        found = backend.propose_contacts(*request)
        np.testing.assert_allclose(found[0].contact.T_obj_ee, made.segment.contact_pose)
        assert found[0].reach >= 10 and len(found[0].keyframes) == found[0].reach + 1
    with pytest.raises(ContactError):  # once
        backend.propose_contacts(*request)
    assert backend.kept["contacts"] == kept


def test_a_hand_round_the_object_goes_back_as_it_came(plan):
    made = contacts(plan)[0]
    at = float(plan.trajectory.time[made.begin])
    sample = clear_sample(plan, made, at)
    assert made.first < sample < made.begin
    assert np.linalg.norm(hand(plan, sample) - hand(plan, made.begin)) > 0.09
    motion = back_to(plan, "arm", sample, plan.trajectory.joints["arm"][made.begin], at)
    assert motion.positions[-1] == pytest.approx(plan.trajectory.joints["arm"][sample])
    assert (
        back_to(
            plan, "arm", made.first, plan.trajectory.joints["arm"][made.first], float(plan.trajectory.time[made.first])
        )
        is None
    )
