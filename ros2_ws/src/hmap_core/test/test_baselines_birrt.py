"""Bi-RRT as a method: it solves a published task, and keeps the contract of methods."""

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.baselines.birrt.space import ObjectSpace
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy
from hmap_core.validation import check

TASK = "published/puck_around"
SEED = 4  # one that is solved at once


def plan(**options):
    return planner.plan(load_scene(TASK, SEED), seed=SEED, planner="birrt", **options)


def test_a_published_task_is_solved_and_the_same_seed_gives_the_same_plan():
    first, second = (plan(time_limit=60.0) for _ in range(2))
    assert check(to_dict(first)).valid
    for name, poses in first.trajectory.objects.items():
        assert np.array_equal(poses, second.trajectory.objects[name])
    assert np.array_equal(first.trajectory.joints["panda"], second.trajectory.joints["panda"])


def test_the_time_limit_ends_the_search_with_a_reason():
    with pytest.raises(PlannerError) as failure:
        plan(time_limit=1e-3)
    assert failure.value.code is Code.TIME_LIMIT
    assert failure.value.search is not None


def test_it_can_be_canceled():
    with pytest.raises(PlannerError) as failure:
        plan(time_limit=60.0, cancel=lambda: True)
    assert failure.value.code is Code.CANCELED


def test_options_of_hmap_are_refused():
    with pytest.raises(InputError, match="birrt"):
        plan(object_path="hmap")


def test_samples_of_a_planar_task_stay_on_the_support():
    scene = load_scene(TASK, 0)
    space = ObjectSpace(scene, scene.start_state(), scene.goal)
    rng = np.random.default_rng(0)
    heights = {round(float(space.sample(rng)[2]), 9) for _ in range(20)}
    assert space.planar and heights == {round(float(space.start[2]), 9)}
    tilted = from_rpy([0.1, -0.2, 0.3], [0.2, 0.1, 0.4])
    assert space.projected(tilted)[2] == pytest.approx(space.start[2])


def test_the_object_stops_before_an_obstacle():
    scene = load_scene(TASK, 0)
    space = ObjectSpace(scene, scene.start_state(), scene.goal)
    line = space.line(space.start, space.goal)  # through the obstacle
    assert 0 < space.reached(line) < len(line) - 1
