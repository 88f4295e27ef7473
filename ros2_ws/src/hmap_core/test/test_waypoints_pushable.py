"""Paths of straight slides in a few directions."""

import numpy as np
import pytest
from geometry_fixtures import TABLE, body_distances, box, yaw

from hmap_core.transforms import interpolate, pose
from hmap_core.types import BodyKind
from hmap_core.waypoints import ObjectPathProblem, pushable

CUBE = box("cube", (0.08, 0.08, 0.08), (0, 0, 0), kind=BodyKind.MOVABLE, mass=0.2)
SQUARE = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
START, GOAL = pose((0.0, 0.0, 0.09)), pose((0.3, 0.2, 0.09))


def slanted(end=GOAL, steps=37):
    return interpolate(START, end, np.linspace(0.0, 1.0, steps))


def found_for(obstacles, poses=None, directions=SQUARE, margin=0.01):
    poses = slanted() if poses is None else poses
    return pushable(ObjectPathProblem(CUBE, poses[0], poses[-1], (TABLE, *obstacles)), poses, directions, margin)


def turns(path):
    way = np.diff(path[:, :2], axis=0)
    way = way / np.linalg.norm(way, axis=1)[:, None]
    return way, int((np.einsum("ij,ij->i", way[1:], way[:-1]) < 0.99).sum())


def test_a_slanted_way_becomes_two_slides():
    path = found_for(())
    way, corners = turns(path)
    assert corners == 1
    assert (np.abs(way @ SQUARE.T).max(axis=1) > 1.0 - 1e-9).all()
    np.testing.assert_allclose(path[[0, -1]], [START, GOAL], atol=1e-9)
    assert np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1).max() <= 0.0101


@pytest.mark.parametrize("corner", [(0.3, 0.0), (0.0, 0.2)])
def test_it_goes_round_what_stands_in_a_corner(corner):
    post = box("post", (0.05, 0.05, 0.2), (*corner, 0.15))
    path = found_for((post,))
    assert turns(path)[1] == 1
    assert min(body_distances(CUBE, T, [post])["post"] for T in path) >= 0.0099


def test_with_posts_in_both_corners_it_goes_in_stairs():
    posts = [box(f"post{k}", (0.05, 0.05, 0.2), (*at, 0.15)) for k, at in enumerate([(0.3, 0.0), (0.0, 0.2)])]
    path = found_for(posts)
    way, corners = turns(path)
    assert corners >= 2
    assert (np.abs(way @ SQUARE.T).max(axis=1) > 1.0 - 1e-9).all()
    assert min(min(body_distances(CUBE, T, posts).values()) for T in path) >= 0.0099


def test_a_way_in_one_of_the_directions_stays():
    path = found_for((), slanted(pose((0.3, 0.0, 0.09))))
    assert turns(path)[1] == 0


@pytest.mark.parametrize(
    "poses",
    [slanted(pose((0.3, 0.2, 0.19))), slanted(pose((0.3, 0.2, 0.09), yaw(0.4)))],
)
def test_a_path_that_rises_or_turns_is_not_for_pushing(poses):
    assert found_for((), poses) is None


def test_there_may_be_no_such_way():
    walls = [
        box(f"wall{k}", (0.02, 0.02, 0.2), (0.15 + s * 0.058, 0.1 - s * 0.058, 0.15)) for k, s in enumerate((-1, 1))
    ]
    assert found_for(walls) is None
    assert found_for((), directions=SQUARE[:1]) is None
    assert found_for((), directions=np.zeros((0, 2))) is None
