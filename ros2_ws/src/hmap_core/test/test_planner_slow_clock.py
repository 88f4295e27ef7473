"""The same seed gives the same plan on a machine that is twenty times slower, within the user's time limit."""

import time

import numpy as np
import pytest
from geometry_fixtures import TABLE, box
from planner_fixtures import carry, crate
from waypoints_fixtures import BAR

from hmap_core.planner import plan
from hmap_core.transforms import pose
from hmap_core.waypoints import NoObjectPath, ObjectPathProblem, plan_waypoints

SLOWER = 20.0
CHECKS = 20_000  # motions
TIME_LIMIT = 600.0  # s, of the slow clock


@pytest.fixture
def slow(monkeypatch):
    """A function after whose call the clock runs SLOWER times as fast."""
    true, began = time.monotonic, time.monotonic()
    return lambda: monkeypatch.setattr(time, "monotonic", lambda: began + SLOWER * (true() - began))


@pytest.mark.parametrize("task", [carry, crate])
def test_the_plan_is_the_same(tmp_path, slow, task):
    scene = task(tmp_path)
    quick = plan(scene, seed=1, time_limit=TIME_LIMIT)
    slow()
    late = plan(scene, seed=1, time_limit=TIME_LIMIT)
    np.testing.assert_array_equal(late.trajectory.time, quick.trajectory.time)
    for robot, joints in quick.trajectory.joints.items():
        np.testing.assert_array_equal(late.trajectory.joints[robot], joints)


def test_a_search_that_fails_ends_in_the_same_place(slow):
    wall = box("wall", (0.05, 4.0, 3.0), (0.0, 0.0, 1.5))
    problem = ObjectPathProblem(BAR, pose((-0.8, 0, 0.09)), pose((0.8, 0, 0.09)), (TABLE, wall), motion="spatial")

    def failed() -> dict:
        rng = np.random.default_rng(0)
        with pytest.raises(NoObjectPath):
            plan_waypoints(problem, rng, TIME_LIMIT, CHECKS)
        return rng.bit_generator.state

    quick = failed()
    slow()
    assert failed() == quick
