"""What the planners' services answer reaches Algorithm 1 as it would from a direct call, failures included."""

import numpy as np
import pytest

from hmap.conversions import path_to_response
from hmap.remote_backend import RosBackend
from hmap.requests import error_from_message
from hmap_core.scenes import load_scene
from hmap_core.waypoints import NoObjectPath, ObjectPath
from hmap_msgs.srv import PlanWaypoints
from hmap_msgs_py.errors import error_to_message


class Answering:
    """Stands in for the caller of services; every call fails with the error of one response."""

    def __init__(self, response):
        self._response = response

    def call(self, service, name, request, limit):
        error = error_from_message(self._response.error)
        error.response = self._response
        raise error


def asked(response) -> NoObjectPath:
    scene = load_scene("tunnel", 0)
    with pytest.raises(NoObjectPath) as error:
        RosBackend(Answering(response)).plan_waypoints(scene, scene.start_state(), "bar", scene.goal, 0, 1.0)
    return error.value


def blocked() -> PlanWaypoints.Response:
    response = PlanWaypoints.Response(blocking=["crate"], removal_known=True, free_without=["crate"])
    response.error = error_to_message(NoObjectPath("'crate' is in the way", ("crate",), ("crate",)))
    return response


def test_what_blocks_and_the_path_without_it_come_over_the_service():
    poses = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (4, 1))
    poses[:, 0] = np.linspace(0.1, 0.4, 4)
    response = blocked()
    path_to_response(ObjectPath(poses, np.array([3]), np.full(4, 0.05), "planar"), "bar", response)
    error = asked(response)
    assert error.free_without == error.blockers == ("crate",)
    np.testing.assert_array_equal(error.path_without.poses, poses)
    assert error.path_without.motion == "planar"


def test_without_a_path_in_the_answer_there_is_none():
    error = asked(blocked())
    assert error.free_without == ("crate",) and error.path_without is None
