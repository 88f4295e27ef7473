"""Transits of an arm by planners of OMPL: over a wall between two poses of the hand."""

import time
from functools import partial

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.exceptions import InputError
from hmap_core.komo.features import pose_params
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.segment import Phase, bit
from hmap_core.planner.ompl_transit import find_transit_ompl
from hmap_core.planner.transit_search import TransitSearch
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, TaskMode

LEFT, RIGHT = (pose((0.45, y, 0.12), (1.0, 0.0, 0.0, 0.0)) for y in (0.25, -0.25))
TRANSIT = bit(Phase.TRANSIT)
TIME_LIMIT = 120.0  # s; a search ends by its checks long before
PER_INTERVAL = 40


class Bench:
    """The arm among table and wall, and its configurations on either side."""

    def __init__(self):
        wall = box("wall", (0.6, 0.02, 0.35), (0.5, 0.0, 0.175), BodyKind.FIXED)
        world = scene(wall, mode=TaskMode.PHYSICAL)
        self.manipulation = Manipulation(world, world.start_state(), "left", None)
        self.collisions = self.manipulation.standing_collisions()
        self.cols = self.collisions.arrays()
        problem = self.manipulation.ik_problem(self.collisions, Phase.TRANSIT)
        home = world.robots["left"].model.home
        places = [pose_params(self.manipulation.T_tip_ee, T) for T in (LEFT, RIGHT)]
        self.left, self.right = (solve_ik(problem, place, home[None]) for place in places)

    def path(self, name: str, seed: int, goal: np.ndarray | None = None) -> np.ndarray | None:
        find = partial(find_transit_ompl, name)
        goal = self.right if goal is None else goal
        search = TransitSearch(self.manipulation, self.collisions, self.cols, self.left, goal, TRANSIT, find)
        return next(search.ways(np.random.default_rng(seed), time.monotonic() + TIME_LIMIT, narrow=True), None)

    def overlap(self, path: np.ndarray) -> float:
        """Greatest depth of an overlap along a path, at PER_INTERVAL configurations of each interval, m."""
        shares = np.linspace(0.0, 1.0, PER_INTERVAL, endpoint=False)[:, None]
        Q = np.concatenate([a + shares * (b - a) for a, b in zip(path, path[1:], strict=False)])
        touching = self.cols._replace(min_distance=np.zeros_like(self.cols.min_distance))
        return float(
            path_violations(Q, np.full(len(Q), TRANSIT), self.manipulation.model.chain, touching, 0.0)[0].max()
        )


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("name", ["RRTConnect", "BITstar", "KPIECE1"])
def test_over_the_wall(bench, name):
    assert bench.overlap(np.array([bench.left, bench.right])) > 0.01
    path = bench.path(name, 0)
    np.testing.assert_array_equal(path[[0, -1]], [bench.left, bench.right])
    assert bench.overlap(path) == 0.0


@pytest.mark.parametrize("name", ["RRTConnect", "BITstar"])
def test_same_seed_gives_the_same_path(bench, name):
    first = bench.path(name, 5)
    bench.path("RRTConnect", 1)
    np.testing.assert_array_equal(first, bench.path(name, 5))


def test_no_path_into_the_wall(bench):
    inside = bench.left.copy()
    inside[0] -= np.arctan2(0.25, 0.45)
    assert bench.overlap(np.array([inside, inside])) > 0.0
    assert bench.path("RRTConnect", 0, inside) is None


def test_unknown_planners_are_refused(bench):
    with pytest.raises(InputError, match="planner 'ompl:RRTconnect' is unknown; allowed: .*RRTConnect"):
        bench.path("RRTconnect", 0)
