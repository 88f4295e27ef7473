"""One suite for every implementation of the planner's protocols: local, over services, and OMPL's."""

from dataclasses import replace

import numpy as np
import pytest
from services import Serving

from hmap.remote_components import RosContactChecker, RosContactFinder, RosObjectPathPlanner, RosSegmentPlanner
from hmap_core.exceptions import Code, ContactError, MotionError
from hmap_core.planner import (
    ContactChecker,
    ContactFinder,
    ContactQuery,
    ContactSearchQuery,
    ObjectPathPlanner,
    ObjectPathQuery,
    SegmentPlanner,
    SegmentQuery,
    local_components,
    plugins,
)
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.scenes import load_scene
from hmap_core.transforms import interpolate
from hmap_core.types import Scene
from hmap_core.waypoints import NoObjectPath

CARRY = """
schema: 1
description: Carry a box to the other side.
mode: physical
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.1], pose: {xyz: [0, 0, -0.05]}}
movable:
  brick: {shape: box, size: [0.05, 0.05, 0.08], pose: {xyz: [0.5, -0.15, 0.04]}, mass: 0.3, friction: 0.6}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}
goal: {object: brick, pose: {xyz: [0.5, 0.15, 0.04]}}
"""
CLOSED = """
  left: {shape: box, size: [0.02, 0.2, 0.2], pose: {xyz: [0.42, 0.15, 0.1]}}
  right: {shape: box, size: [0.02, 0.2, 0.2], pose: {xyz: [0.58, 0.15, 0.1]}}
  front: {shape: box, size: [0.18, 0.02, 0.2], pose: {xyz: [0.5, 0.05, 0.1]}}
  back: {shape: box, size: [0.18, 0.02, 0.2], pose: {xyz: [0.5, 0.25, 0.1]}}
  lid: {shape: box, size: [0.18, 0.22, 0.02], pose: {xyz: [0.5, 0.15, 0.21]}}
movable:"""
LIMIT = 300.0  # s; a busy machine is slow
COUNT = 4

PATHS = {
    "hmap": lambda: plugins.create(plugins.OBJECT_PATH_PLANNERS, "hmap"),
    "ompl:RRTConnect": lambda: plugins.create(plugins.OBJECT_PATH_PLANNERS, "ompl:RRTConnect"),
    "service": lambda: RosObjectPathPlanner(Serving()),
}
FINDERS = {"local": lambda: local_components().contacts, "service": lambda: RosContactFinder(Serving())}
CHECKERS = {"local": LocalContactChecker, "service": lambda: RosContactChecker(Serving())}
SEGMENTS = {"local": KomoSegmentPlanner, "service": lambda: RosSegmentPlanner(Serving())}


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    file = tmp_path_factory.mktemp("contracts") / "carry.yaml"
    file.write_text(CARRY)
    return load_scene(str(file))


@pytest.fixture(scope="module")
def closed(tmp_path_factory) -> Scene:
    """The goal is in a closed box."""
    file = tmp_path_factory.mktemp("contracts") / "closed.yaml"
    file.write_text(CARRY.replace("\nmovable:", CLOSED))
    return load_scene(str(file))


@pytest.fixture(scope="module")
def poses(scene) -> np.ndarray:
    return interpolate(scene.bodies["brick"].pose, scene.goal.pose, np.linspace(0.0, 1.0, 31))


@pytest.fixture(params=PATHS, scope="module")
def path_planner(request) -> ObjectPathPlanner:
    return PATHS[request.param]()


@pytest.fixture(params=FINDERS, scope="module")
def finder(request) -> ContactFinder:
    return FINDERS[request.param]()


@pytest.fixture(params=CHECKERS, scope="module")
def checker(request) -> ContactChecker:
    return CHECKERS[request.param]()


@pytest.fixture(params=SEGMENTS, scope="module")
def segment_planner(request) -> SegmentPlanner:
    return SEGMENTS[request.param]()


def path_query(scene, seed=3) -> ObjectPathQuery:
    return ObjectPathQuery(scene, scene.start_state(), scene.goal, seed, LIMIT, 20_000)


def test_a_path_leads_from_start_to_goal_and_repeats_by_seed(path_planner, scene):
    assert isinstance(path_planner, ObjectPathPlanner)
    path, again = (path_planner.plan_path(path_query(scene)) for _ in range(2))
    np.testing.assert_allclose(path.poses[[0, -1]], [scene.bodies["brick"].pose, scene.goal.pose], atol=1e-6)
    np.testing.assert_array_equal(path.poses, again.poses)
    assert len(path.clearance) == len(path.poses) and path.cuts[-1] == len(path.poses) - 1


def test_without_a_path_what_blocks_is_named(path_planner, closed):
    with pytest.raises(NoObjectPath) as error:
        path_planner.plan_path(path_query(closed))
    assert (error.value.stage, error.value.code) == ("waypoints", Code.NO_OBJECT_PATH)
    assert set(error.value.blockers) <= closed.bodies.keys() and error.value.blockers


def search_query(scene, poses, seed=3) -> ContactSearchQuery:
    return ContactSearchQuery(scene, scene.start_state(), "brick", poses, ("arm",), None, COUNT, seed, LIMIT)


def test_contacts_are_found_with_their_configurations_and_repeat_by_seed(finder, scene, poses):
    assert isinstance(finder, ContactFinder)
    found, again = (finder.find_contacts(search_query(scene, poses)) for _ in range(2))
    assert 0 < len(found) <= COUNT
    for contact, other in zip(found, again, strict=True):
        assert contact.robot == "arm" and contact.keyframes.shape == (contact.reach + 1, 7)
        np.testing.assert_array_equal(contact.keyframes, other.keyframes)


def test_out_of_reach_there_is_no_contact(finder, scene, poses):
    state, far = scene.start_state(), poses + np.array([3.0, 0, 0, 0, 0, 0, 0])
    state.poses["brick"] = far[0]
    with pytest.raises(ContactError) as error:
        finder.find_contacts(replace(search_query(scene, far), state=state))
    assert error.value.code == Code.NO_CONTACT


def test_contacts_that_serve_for_too_few_poses_are_not_looked_for(finder, scene, poses):
    whole = replace(search_query(scene, poses), min_reach=len(poses) - 1)
    assert {contact.reach for contact in finder.find_contacts(whole)} == {len(poses) - 1}
    with pytest.raises(ContactError) as error:
        finder.find_contacts(replace(whole, min_reach=len(poses)))
    assert error.value.code == Code.NO_CONTACT


@pytest.fixture(scope="module")
def proposals(scene, poses):
    query = ContactQuery(scene, scene.start_state(), "brick", poses, "arm", np.random.default_rng(0))
    return next(iter(local_components().proposer.propose(query))).contacts[:60]


def contact_query(scene, poses) -> ContactQuery:
    return ContactQuery(scene, scene.start_state(), "brick", poses, "arm", np.random.default_rng(0))


def test_checked_contacts_are_among_the_proposed_ones_and_serve_far_enough(checker, scene, poses, proposals):
    assert isinstance(checker, ContactChecker)
    query = contact_query(scene, poses)
    found = checker.check(query, proposals)
    assert found and all(any(contact.contact is one for one in proposals) for contact in found)
    farther = checker.check(contact_query(scene, poses), proposals, beyond=len(poses) - 2)
    assert all(contact.reach == len(poses) - 1 for contact in farther)
    assert checker.check(contact_query(scene, poses), proposals, beyond=len(poses) - 1) == []
    assert checker.check(contact_query(scene, poses), []) == []


def test_promising_contacts_are_among_the_proposed_ones(checker, scene, poses, proposals):
    promising = checker.promising(contact_query(scene, poses), proposals)
    assert promising and all(any(contact is one for one in proposals) for contact in promising)


@pytest.fixture(scope="module")
def contact(scene, poses):
    return local_components().contacts.find_contacts(search_query(scene, poses))[0]


def test_a_segment_begins_in_the_state_and_ends_with_the_object_at_its_last_pose(
    segment_planner, scene, poses, contact
):
    assert isinstance(segment_planner, SegmentPlanner)
    state, ahead = scene.start_state(), poses[: contact.reach + 1]
    motion = segment_planner.plan_segment(SegmentQuery(scene, state, "brick", contact, ahead, 5, LIMIT))
    trajectory = motion.trajectory
    assert trajectory.time[0] == 0.0 and motion.segments[0].start == 0.0
    np.testing.assert_allclose(trajectory.joints["arm"][0], state.q["arm"], atol=1e-9)
    np.testing.assert_allclose(trajectory.objects["brick"][-1][:3], ahead[-1][:3], atol=2e-3)
    assert motion.segments[-1].end == pytest.approx(trajectory.time[-1])


def test_a_segment_that_cannot_be_is_a_coded_error(segment_planner, scene, poses, contact):
    """The arm would have to jump: the configurations are those of another place."""
    away = replace(contact, keyframes=np.tile(scene.robots["arm"].model.home + 1.0, (contact.reach + 1, 1)))
    far = poses[: contact.reach + 1] + np.array([2.0, 0, 0, 0, 0, 0, 0])
    state = scene.start_state()
    state.poses["brick"] = far[0]
    with pytest.raises(MotionError) as error:
        segment_planner.plan_segment(SegmentQuery(scene, state, "brick", away, far, 5, LIMIT))
    assert error.value.code == Code.NO_MOTION
