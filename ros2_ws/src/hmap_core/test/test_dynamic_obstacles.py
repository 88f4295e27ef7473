"""Where obstacles appear and how they move: near the path, in nothing, the same for the same seed."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.simulation.dynamic import BODY_DISTANCE, REACH, ROBOT_DISTANCE, STEP, Around, ObstacleSource, sphere
from hmap_core.types import Goal

SIZE = (0.06, 0.06, 0.06)
START, END = np.array([0.5, -0.15, 0.03]), np.array([0.5, 0.15, 0.03])
PATH = np.array([transforms.pose(START + s * (END - START)) for s in np.linspace(0.0, 1.0, 20)])
RADII = (0.02, 0.04)
SEEDS = range(8)


@pytest.fixture(scope="module")
def table():
    return scene(box("box", SIZE, START), goal=Goal("box", transforms.pose(END)))


def source(scene, seed: int = 0, **options) -> ObstacleSource:
    return ObstacleSource(scene, PATH, np.random.default_rng(seed), **options)


def distance_to_path(body) -> float:
    return float(np.linalg.norm(PATH[:, :3] - body.pose[:3], axis=1).min())


@pytest.mark.parametrize("seed", SEEDS)
def test_an_obstacle_appears_near_the_path_and_moves_on_in_free_space(table, seed):
    state, found = table.start_state(), source(table, seed)
    body = found.appear(state, "ball", RADII)
    assert RADII[0] <= body.shapes[0].size[0] <= RADII[1]
    for _ in range(6):
        assert distance_to_path(body) <= REACH
        radius, height = body.shapes[0].size[0], body.pose[2]
        assert height >= radius  # above the table
        for place in (START, END):  # farther off than a ball in the box would be
            assert np.linalg.norm(body.pose[:3] - place) > radius + 0.5 * SIZE[0] + BODY_DISTANCE - 1e-9
        moved = found.move(state, body)
        if moved is not None:
            assert np.linalg.norm(moved.pose[:3] - body.pose[:3]) == pytest.approx(STEP)
            body = moved


def test_the_same_seed_gives_the_same_obstacles(table):
    state = table.start_state()
    one, two, other = (source(table, seed).appear(state, "ball", RADII) for seed in (3, 3, 4))
    assert np.array_equal(one.pose, two.pose) and one.shapes[0].size == two.shapes[0].size
    assert not np.array_equal(one.pose, other.pose)


def test_places_in_or_next_to_a_robot_are_not_free(table):
    state = table.start_state()
    around = Around(table, state)
    robot = next(iter(table.robots.values()))
    beside = robot.base_pose[:3] + np.array([0.0, 0.0, 0.2])
    assert not around.free(sphere("ball", 0.02, beside))
    assert around.free(sphere("ball", 0.02, beside + np.array([-0.2 - ROBOT_DISTANCE, 0.0, 0.0])))


def test_what_is_not_allowed_is_not_used(table):
    state = table.start_state()
    assert source(table, allowed=lambda body: False).appear(state, "ball", RADII) is None
    high = source(table, allowed=lambda body: body.pose[2] > 0.15).appear(state, "ball", RADII)
    assert high.pose[2] > 0.15


def test_a_wall_everywhere_leaves_no_place(table):
    wall = replace(box("wall", (2.0, 2.0, 2.0), (0.5, 0.0, 0.5)), kind="fixed")
    full = replace(table, bodies=table.bodies | {"wall": wall})
    assert source(full).appear(full.start_state(), "ball", RADII) is None


@pytest.mark.parametrize("radii", [(0.0, 0.1), (0.2, 0.1)])
def test_radii_that_are_none_are_refused(table, radii):
    with pytest.raises(InputError, match="radii"):
        source(table).appear(table.start_state(), "ball", radii)


def test_a_path_without_poses_is_refused(table):
    with pytest.raises(InputError, match="0 poses"):
        ObstacleSource(table, np.zeros((0, 7)), np.random.default_rng(0))
