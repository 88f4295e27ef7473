"""Other arms end to end: ``hmap robot new`` for a URDF, then pick and place, and push, under dynamics."""

import pytest
from arm_fixtures import ARMS, new_robot, urdf_of, write_task

from hmap_core.evaluation.replanning import replanner
from hmap_core.evaluation.trial import DEFAULT_REPLANS
from hmap_core.planner import plan
from hmap_core.scenes import load_scene
from hmap_core.simulation.execute import execute_closed_loop
from hmap_core.types import SegmentKind

KINDS = {"place": SegmentKind.GRASP, "push": SegmentKind.PUSH}


@pytest.fixture(scope="module", params=ARMS)
def robot(request, tmp_path_factory):
    """The robot file that is written for an arm's URDF, without a change."""
    return new_robot(tmp_path_factory.mktemp(request.param), urdf_of(request.param), "--samples", "2000")


@pytest.mark.parametrize("task", KINDS)
def test_a_new_arm_does_a_task(robot, task):
    path = write_task(robot.parent, robot, task)
    made = plan(load_scene(str(path), seed=0), seed=0)
    assert any(segment.kind == KINDS[task] for segment in made.segments)
    report = execute_closed_loop(made, replanner(0, 60.0), DEFAULT_REPLANS)
    assert report.solved, report.reason
