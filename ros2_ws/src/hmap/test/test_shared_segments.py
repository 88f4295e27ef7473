"""What two robots do together, over the service as in one process; and requests that do not fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from services import Serving

from hmap.remote_components import RosSegmentPlanner
from hmap_core import planner
from hmap_core.exceptions import Code, InputError
from hmap_core.planner import SharedQuery, local_components
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.scenes import load_scene

EXAMPLES = Path(__file__).parents[4] / "docs" / "examples"


class Recorded(KomoSegmentPlanner):
    """Plans in this process, and keeps what two robots were asked for, and what came of it."""

    def __init__(self):
        super().__init__()
        self.last = None

    def plan_shared(self, query):
        motion = super().plan_shared(query)
        self.last = query, motion
        return motion


@pytest.fixture(scope="module", params=["two_arms", "hand_over"])
def asked(request):
    """A query of a planning job, and the motion that was planned for it in this process."""
    segments = Recorded()
    scene = load_scene(str(EXAMPLES / f"{request.param}.yaml"))
    planner.plan(scene, seed=0, components=local_components(segments=segments))
    return segments.last


def test_the_service_plans_the_same_motion(asked):
    query, motion = asked
    serving = Serving()
    remote = RosSegmentPlanner(serving).plan_shared(replace(query, time_limit=300.0))
    assert serving.called == ["solve_segment"]
    assert [(s.robot, s.kind, s.object) for s in remote.segments] == [
        (s.robot, s.kind, s.object) for s in motion.segments
    ]
    assert remote.trajectory.joints.keys() == motion.trajectory.joints.keys() == query.scene.robots.keys()
    np.testing.assert_allclose(remote.trajectory.objects["bar"][-1], motion.trajectory.objects["bar"][-1], atol=2e-3)


def wrong(query: SharedQuery):
    """Queries that do not fit, each with what the reason names."""
    first, second = query.contacts
    yield replace(query, contacts=(first, second, second)), "partners has 2 contacts"
    yield replace(query, contacts=(first, first)), f"partners[0].robot is '{first.robot}'"
    short = replace(second, reach=0, keyframes=second.keyframes[:1])
    yield replace(query, contacts=(first, short)), "has reach 0"
    if query.hand_over:
        yield replace(query, object_poses=query.object_poses[[0, 2]]), "a hand-over has 3"


def test_requests_that_do_not_fit_are_refused(asked):
    for query, reason in wrong(asked[0]):
        with pytest.raises(InputError) as error:
            RosSegmentPlanner(Serving()).plan_shared(query)
        assert error.value.code is Code.INVALID_INPUT and reason in error.value.reason
