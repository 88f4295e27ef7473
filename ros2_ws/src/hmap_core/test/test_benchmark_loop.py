"""The benchmark's loop: other object paths where one does not serve, and a judge of the whole chain of motions."""

from dataclasses import replace

import numpy as np
import pytest

from hmap_core.benchmark.loop import HMAP, MIN_DISTANCES, judge_loop
from hmap_core.benchmark.problems.puck import DISC, OBSTACLE, puck_loop
from hmap_core.benchmark.problems.tunnel_push import APPROACH, tunnel_push
from hmap_core.benchmark.sampling import straight_push_is_free
from hmap_core.transforms import pose

ALL_FAIL_ON_THE_SHORTEST_WAY = 4  # seed: an obstacle that is higher than the hand is long
SAFE = 0.005  # m


@pytest.fixture(scope="module")
def solved():
    instance = puck_loop(ALL_FAIL_ON_THE_SHORTEST_WAY)
    return instance, HMAP.run(instance, HMAP.configurations(instance))


def test_another_object_path_is_tried_where_no_contact_serves(solved):
    instance, answer = solved
    assert answer.claimed
    assert judge_loop(instance, answer.path) == []


def test_every_second_object_path_leaves_the_hand_room():
    instance = puck_loop(ALL_FAIL_ON_THE_SHORTEST_WAY)
    middle = instance.scene.bodies[OBSTACLE].pose[:2]
    near, far = (np.linalg.norm(HMAP.object_path(instance, k)[:, :2] - middle, axis=1).min() for k in (0, 1))
    assert far > near + (MIN_DISTANCES[1] - MIN_DISTANCES[0]) / 2.0


def test_the_judge_sees_the_end_and_the_turned_quaternion(solved):
    instance, answer = solved
    goal = instance.scene.goal
    for T, wrong in ((goal.pose * [1, 1, 1, -1, -1, -1, -1], []), (goal.pose + np.eye(7)[0] * 0.01, ["end"])):
        other = replace(instance, scene=replace(instance.scene, goal=replace(goal, pose=T)))
        found = judge_loop(other, answer.path)
        assert len(found) == len(wrong) and all("does not end at its goal" in text for text in found)
    moved = replace(instance.scene.bodies[DISC], pose=goal.pose)
    scene = replace(instance.scene, bodies=instance.scene.bodies | {DISC: moved})
    assert any("does not begin" in text for text in judge_loop(replace(instance, scene=scene), answer.path))


def test_a_straight_way_is_proved_free_or_it_is_not():
    instance = tunnel_push(0)
    attachment, goal = instance.attachments[0], instance.scene.goal.pose
    scene = instance.scene
    rng = np.random.default_rng(0)
    assert straight_push_is_free(scene, 0.0, attachment, goal, APPROACH, rng, SAFE)
    beyond = goal + pose((1.5, 0.0, 0.0)) - pose()
    assert not straight_push_is_free(scene, 0.0, attachment, beyond, APPROACH, rng, SAFE)
