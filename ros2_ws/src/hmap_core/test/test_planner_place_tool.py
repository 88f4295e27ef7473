"""A tool that is attached when a plan is given up is placed where it was picked."""

import numpy as np
import pytest
from tool_fixtures import push_out

from hmap_core import transforms
from hmap_core.plan_file import to_dict
from hmap_core.planner import plan
from hmap_core.planner.place_tool import grip_at, plan_place, tools_used
from hmap_core.trajectory.samples import index_at, state_at
from hmap_core.validation import check
from hmap_core.validation.report import Kind

TIME_LIMIT = 20.0  # s


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return plan(push_out(tmp_path_factory.mktemp("push_out")), seed=1)


def while_pushing(found) -> int:
    pushed = next(s for s in found.segments if s.manipulator == "stick")
    return index_at(found.trajectory.time, 0.5 * (pushed.start + pushed.end))


def test_only_what_others_are_moved_with_is_a_tool_that_is_used(found):
    assert tools_used(found) == {"stick"}


def test_the_grip_is_that_in_which_the_tool_was_taken(found):
    grip = grip_at(found, "arm", "stick", while_pushing(found))
    np.testing.assert_allclose(grip.T_place, found.trajectory.objects["stick"][0], atol=1e-9)
    way = np.abs(np.diff(found.trajectory.objects["stick"], axis=0)).max(axis=1)
    lifted = int(np.flatnonzero(way > 1e-6)[0])
    np.testing.assert_allclose(grip.contact.keyframes[0], found.trajectory.joints["arm"][lifted], atol=1e-6)
    assert grip_at(found, "arm", "stick", 0) is None
    assert grip_at(found, "arm", "stick", len(found.trajectory.time) - 1) is None
    assert grip_at(found, "arm", "cube", while_pushing(found)) is None


def test_it_is_put_there_from_the_middle_of_a_push_and_nothing_is_hit(found):
    k = while_pushing(found)
    state = state_at(found, k)
    back = plan_place(found.scene, state, grip_at(found, "arm", "stick", k), 0, TIME_LIMIT)
    T_end = back.trajectory.objects["stick"][-1]
    moved, turned = transforms.distance(T_end, found.scene.bodies["stick"].pose)
    assert moved < 1e-3 and turned < 1e-2
    crate = back.trajectory.objects["crate"]
    np.testing.assert_array_equal(crate, np.tile(state.poses["crate"], (len(crate), 1)))
    assert {v.kind for v in check(to_dict(back)).violations} <= {Kind.GOAL_MISSED}
