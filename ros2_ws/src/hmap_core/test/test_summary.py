"""The numbers of a plan that people see: the new plans because of obstacles among them."""

from dataclasses import replace

import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim

from hmap_core import transforms
from hmap_core.types import Goal
from hmap_core.viz.summary import summary


@pytest.fixture(scope="module")
def plan():
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    scene = sim.scene(box, goal=Goal("box", transforms.pose((0.5, 0.2, 0.03))))
    return plan_fixtures.drag_plan(scene, "box", 0.06, np.array([0.0, 0.3, 0.0]))


def replans(*seconds):
    keys = "planning_s", "planning_cpu_s", "with_judge_s", "with_judge_cpu_s"
    return [dict(zip(keys, row, strict=True)) for row in seconds]


def test_a_plan_that_was_not_blocked_says_nothing_of_new_plans(plan):
    assert "new plans" not in summary(plan)


def test_medians_leave_out_what_is_not_known(plan):
    stats = {"obstacle_replans": replans((0.1, None, 0.2, None), (0.3, 0.25, 0.4, 0.35), (0.9, 0.35, 1.0, 0.45))}
    lines = summary(replace(plan, stats=stats))
    assert lines["new plans"] == "3 because of obstacles"
    assert lines["to plan"] == "0.30 s, cpu 0.30 s (median)"
    assert lines["with the judge"] == "0.40 s, cpu 0.40 s (median)"


def test_where_services_planned_no_processor_time_is_known(plan):
    lines = summary(replace(plan, stats={"obstacle_replans": replans((0.1, None, 0.2, None))}))
    assert lines["to plan"] == "0.10 s, cpu - (median)"
