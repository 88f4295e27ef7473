"""``ompl:NAME`` as an object-path planner chosen by name."""

import numpy as np
import pytest

from hmap_core.exceptions import InputError
from hmap_core.planner.object_path import object_path_problem
from hmap_core.planner.plugins import OBJECT_PATH_PLANNERS, create, plugins
from hmap_core.planner.protocols import ObjectPathPlanner, ObjectPathQuery
from hmap_core.scenes.loader import load_scene
from hmap_core.waypoints.ompl_planner import plan_waypoints_ompl

TIME_LIMIT = 120.0  # s


def test_published_tunnel_by_name():
    scene = load_scene("published/tunnel")
    query = ObjectPathQuery(scene, scene.start_state(), scene.goal, 0, TIME_LIMIT)
    planner = create(OBJECT_PATH_PLANNERS, "ompl:BITstar")
    assert isinstance(planner, ObjectPathPlanner)
    path = planner.plan_path(query)
    alone = plan_waypoints_ompl("BITstar", object_path_problem(query), np.random.default_rng(0), TIME_LIMIT)
    np.testing.assert_array_equal(path.poses, alone.poses)


@pytest.mark.parametrize("name", ["ompl", "ompl:", "ompl:BITstr"])
def test_unknown_names_are_refused_with_those_that_are_there(name):
    with pytest.raises(InputError, match="is unknown; allowed: .*BITstar"):
        create(OBJECT_PATH_PLANNERS, name)


def test_is_listed():
    assert plugins(OBJECT_PATH_PLANNERS)["ompl"].origin == "hmap_core"
