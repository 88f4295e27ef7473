"""The search for transits of an arm with an attached stick, from above a board to below it."""

import time

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.komo.features import pose_params
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.segment import Phase, bit
from hmap_core.planner.segments import attach_body
from hmap_core.planner.transit_search import ROOMS, TransitSearch
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, ContactKind, ContactPoint, TaskMode

OVER, UNDER = pose((0.42, 0.0, 0.2), (1.0, 0.0, 0.0, 0.0)), pose((0.42, 0.0, 0.04), (1.0, 0.0, 0.0, 0.0))
T_EE_STICK = pose((-0.12, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))  # the stick lies ahead of the hand
TRANSIT = bit(Phase.TRANSIT)
PER_INTERVAL = 40


class Bench:
    """The arm with the stick among table and board, and its configurations over and under the board."""

    def __init__(self, mode: TaskMode):
        board = box("board", (0.3, 0.5, 0.015), (0.65, 0.0, 0.085), BodyKind.FIXED)
        stick = box("stick", (0.3, 0.02, 0.02), (0.0, 0.6, 0.01), BodyKind.TOOL)
        hold = ContactPoint(
            ContactKind.GRASP, T_EE_STICK, np.zeros(3), np.array([0, 1.0, 0]), 0.02, np.array([0, 0, 1.0])
        )
        attached = attach_body(scene(board, stick, mode=mode), "left", "stick", hold, stick.pose)
        state = attached.start_state()
        state.gripper["left"] = 0.02
        self.manipulation = Manipulation(attached, state, "left", None)
        self.chain = self.manipulation.model.chain
        self.collisions = self.manipulation.standing_collisions()
        self.cols = self.collisions.arrays()
        problem = self.manipulation.ik_problem(self.collisions, Phase.TRANSIT)
        home = attached.robots["left"].model.home
        places = [pose_params(self.manipulation.T_tip_ee, T) for T in (OVER, UNDER)]
        self.over, self.under = (solve_ik(problem, place, home[None]) for place in places)
        self.search = TransitSearch(self.manipulation, self.collisions, self.cols, self.over, self.under, TRANSIT)

    def ways(self, seed: int, narrow: bool = True) -> list[np.ndarray]:
        return list(self.search.ways(np.random.default_rng(seed), time.monotonic() + 60.0, narrow))

    def overlap(self, way: np.ndarray) -> float:
        """How deep anything is in anything else on a way, looked at closely, m."""
        shares = np.linspace(0.0, 1.0, PER_INTERVAL, endpoint=False)[:, None]
        Q = np.concatenate([a + shares * (b - a) for a, b in zip(way, way[1:], strict=False)])
        touching = with_min_distance(self.cols, 0.0)
        return float(path_violations(Q, np.full(len(Q), TRANSIT), self.chain, touching, 0.0)[0].max())


def with_min_distance(cols, min_distance: float):
    return cols._replace(min_distance=np.full_like(cols.min_distance, min_distance))


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(TaskMode.PHYSICAL)


@pytest.mark.parametrize("seed", range(2))
def test_a_stick_comes_under_a_board_and_not_through_it(bench, seed):
    assert bench.overlap(np.array([bench.over, bench.under])) > 0.01
    ways = bench.ways(seed)
    assert len(ways) == len(ROOMS) + 1
    for way in ways:
        np.testing.assert_array_equal(way[[0, -1]], [bench.over, bench.under])
        assert bench.overlap(way) == 0.0


def test_the_first_way_has_room(bench):
    assert bench.search.has_room(bench.ways(0)[0])
    assert not bench.search.has_room(np.array([bench.over, bench.under]))


def test_the_same_seed_gives_the_same_way(bench):
    np.testing.assert_array_equal(bench.ways(5)[0], bench.ways(5)[0])


def test_in_kinematic_tasks_no_room_is_asked_for():
    kinematic = Bench(TaskMode.KINEMATIC)
    assert kinematic.ways(0, narrow=False) == []
    assert kinematic.search.has_room(np.array([kinematic.over, kinematic.under]))


def test_a_goal_inside_of_something_is_not_searched_for(bench):
    inside = bench.over.copy()
    inside[3] -= 0.45
    search = TransitSearch(bench.manipulation, bench.collisions, bench.cols, bench.over, inside, TRANSIT)
    assert bench.overlap(np.array([inside, inside])) > 0.0
    assert list(search.ways(np.random.default_rng(0), time.monotonic() + 60.0, narrow=True)) == []


def test_a_way_to_where_one_is_stays_there(bench):
    search = TransitSearch(bench.manipulation, bench.collisions, bench.cols, bench.over, bench.over, TRANSIT)
    ways = list(search.ways(np.random.default_rng(0), time.monotonic() + 60.0, narrow=True))
    assert ways and all(np.array_equal(way, np.tile(bench.over, (len(way), 1))) for way in ways)
