"""Spatial paths whose first part slides on the support."""

import numpy as np
from geometry_fixtures import TABLE, box
from waypoints_fixtures import tunnel

from hmap_core.planner.segments.object_steps import thinned
from hmap_core.transforms import interpolate, pose
from hmap_core.types import BodyKind
from hmap_core.waypoints import ObjectPathProblem, slide_then_lift
from hmap_core.waypoints.checker import Geometry, ObjectChecker

BAR = box("bar", (0.3, 0.08, 0.08), (0, 0, 0), kind=BodyKind.MOVABLE)
START, OUT, UP, GOAL = (pose(p) for p in ((0, 0.25, 0.09), (-0.4, 0.25, 0.095), (-0.4, 0.25, 0.3), (-0.4, -0.3, 0.3)))


def flown(*corners):
    legs = [interpolate(a, b, np.linspace(0, 1, 21)) for a, b in zip(corners, corners[1:], strict=False)]
    return np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])


def problem(*obstacles):
    return ObjectPathProblem(BAR, START, GOAL, (TABLE, *tunnel("t", 0.3, 0.0), *obstacles))


def test_a_lifted_path_slides_as_far_as_it_can_and_then_rises():
    way = slide_then_lift(problem(), flown(START, OUT, UP, GOAL))
    np.testing.assert_allclose(way[[0, -1]], [START, GOAL], atol=1e-9)
    level = way[:, 2] < START[2] + 1e-9
    head = int(np.argmin(level)) if not level.all() else len(way)
    assert np.linalg.norm(way[head - 1, :2] - START[:2]) > 0.39
    assert (np.diff(way[head:, 2]) >= -1e-9).all() or way[head:, 2].max() >= 0.3 - 1e-9
    free = ObjectChecker(problem(), Geometry(problem()), False, 0.0)
    assert all(free.motion_free(a, b) for a, b in zip(way, way[1:], strict=False))


def test_an_obstacle_on_the_support_ends_the_slide():
    step = box("step", (0.02, 0.5, 0.01), (-0.36, 0.25, 0.055))
    over = (pose((-0.17, 0.25, 0.09)), pose((-0.17, 0.25, 0.115)), pose((-0.5, 0.25, 0.3)))
    way = slide_then_lift(problem(step), flown(START, *over))
    sliding = way[way[:, 2] < START[2] + 1e-9]
    assert -0.25 < sliding[-1, 0] < -0.1


def test_a_body_that_does_not_stand_does_not_slide():
    high = ObjectPathProblem(BAR, UP, GOAL, (TABLE,))
    assert slide_then_lift(high, flown(UP, GOAL)) is None
    assert slide_then_lift(problem(), flown(START, pose((0, 0.25, 0.1)))) is None


def test_where_the_path_goes_straight_up_the_slide_has_no_pose_twice():
    """A contact that served along such poses had no step, which ended planning with an input error."""
    over = pose((0, 0.25, 0.15))
    way = slide_then_lift(problem(), flown(START, over, pose((-0.4, 0.25, 0.15)), UP, GOAL))
    assert (np.linalg.norm(np.diff(way, axis=0), axis=1) > 1e-6).all()
    np.testing.assert_allclose(way[[0, -1]], [START, GOAL], atol=1e-9)


def test_the_steps_of_a_contact_have_both_ends():
    still = np.repeat(START[None], 5, axis=0)
    poses, keyframes = thinned(still, np.arange(5.0)[:, None], 1.0)
    assert poses.shape == (2, 7)
    np.testing.assert_array_equal(keyframes[:, 0], [0.0, 4.0])
    assert len(thinned(still[:1], np.zeros((1, 1)), 1.0)[0]) == 1  # picked, and not carried
