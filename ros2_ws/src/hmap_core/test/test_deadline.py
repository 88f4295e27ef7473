"""Long steps look at the clock: the judge, contacts, inverse kinematics and the optimiser end with the time limit."""

import gc
import sys
import time
import weakref
from functools import partial

import numpy as np
import pytest
from many_parts_fixtures import ends_within
from numba import njit
from numba.core.compiler_lock import global_compiler_lock

from hmap_core import deadline, plan_file, planner
from hmap_core.benchmark import many_parts
from hmap_core.collision import grown
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.exceptions import Code, MotionError, PlannerError
from hmap_core.garbage import only_new_garbage
from hmap_core.komo.ik import solve_ik
from hmap_core.planner import hmap_planner
from hmap_core.scenes import load_scene
from hmap_core.timed_work import LOADING, work_until
from hmap_core.validation import check
from hmap_core.waypoints import NoObjectPath, plan_waypoints

PARTS = 300
PLAN_MODULE = sys.modules[planner.plan.__module__]  # the package has a function of the same name
LONGEST = 0.1  # s of CPU time between two looks, on a machine that may be busy


def test_a_deadline_holds_within_its_block_and_those_inside():
    deadline.check_time()
    with deadline.until(time.monotonic() + 60.0):
        deadline.check_time()
        with deadline.until(time.monotonic() - 1.0), pytest.raises(PlannerError) as error:
            deadline.check_time()
        assert error.value.code == Code.TIME_LIMIT
        with deadline.until(np.inf):
            assert deadline.deadline() < time.monotonic() + 61.0
        deadline.check_time()
    assert deadline.deadline() == np.inf


def test_inverse_kinematics_ends():
    with deadline.until(time.monotonic() - 1.0), pytest.raises(PlannerError, match="no time is left"):
        solve_ik(None, np.zeros(0), np.zeros((1, 7)))


@pytest.fixture(scope="module")
def plan():
    return planner.plan(many_parts.carried(PARTS, PARTS, 0), seed=0, time_limit=120.0)


def test_the_judge_looks_at_the_clock_all_the_time(plan):
    """The best of three, as garbage collection and other work on the machine take their time, too."""
    content, longest = plan_file.to_dict(plan), []
    expected = check(content)  # what it needs is imported
    for _ in range(3):
        looks = [time.thread_time()]
        assert check(content, partial(_look, looks)) == expected
        looks.append(time.thread_time())
        longest.append(np.diff(looks).max())
    assert expected.valid and min(longest) < LONGEST


def _look(looks):
    looks.append(time.thread_time())


def test_the_judge_ends_when_it_is_told_to(plan):
    content, left = plan_file.to_dict(plan), [0]

    def look():
        left[0] -= 1
        if left[0] < 0:
            raise PlannerError("no time is left", Code.TIME_LIMIT)

    for count in (0, 10, 1000, 5000):
        left[0] = count
        with pytest.raises(PlannerError, match="no time is left"):
            check(content, look)


def test_a_plan_that_is_not_judged_in_time_is_none(monkeypatch):
    def late(content, check_time):
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            check_time()

    monkeypatch.setattr(hmap_planner, "check", late)
    with pytest.raises(PlannerError, match="no plan within 3 s") as error:
        planner.plan(load_scene("published/bolt", 0), seed=0, time_limit=3.0)
    assert error.value.code == Code.TIME_LIMIT


@pytest.mark.parametrize("limit", [0.3, 0.8])
def test_whole_plans_among_many_parts_keep_their_time_limit(plan, limit):
    """It was up to four times the limit."""
    scene = many_parts.carried(PARTS, PARTS, 1)
    assert ends_within(1.1 * limit + LONGEST, lambda: many_parts.run_plan(scene, limit))


def test_some_time_is_left_for_the_last_step():
    assert deadline.usable(0.3) == pytest.approx(0.255)
    assert deadline.usable(60.0) == pytest.approx(60.0 - deadline.MOST_RESERVE)


def test_no_code_is_loaded_that_would_be_late():
    with global_compiler_lock:  # as Numba does before it loads or compiles a function
        pass
    with work_until(time.monotonic() + 60.0), global_compiler_lock:
        pass
    with work_until(time.monotonic() + 0.5 * LOADING), pytest.raises(PlannerError, match="no time is left"):
        with global_compiler_lock:
            pass
    assert not global_compiler_lock.is_locked()


def test_code_of_a_function_is_loaded_to_its_end():
    with global_compiler_lock, work_until(time.monotonic() - 1.0), global_compiler_lock:
        pass


def test_compiling_is_not_counted_as_processor_time():
    allowed = 0.1  # s
    with work_until(time.monotonic() + 60.0), deadline.within_cpu_time(allowed):
        began = time.process_time()
        assert njit(lambda x: np.sort(x).sum())(np.arange(3.0)) == 3.0
        assert time.process_time() - began > allowed and not deadline.cpu_time_used_up()
        end = time.process_time() + 1.5 * allowed
        while time.process_time() < end:
            pass
        assert deadline.cpu_time_used_up()


class Cycle:
    """Only a collection deletes it."""

    def __init__(self):
        self.own = self


def collections() -> int:
    """How often all objects were looked through."""
    return gc.get_stats()[2]["collections"]


def test_garbage_that_was_there_before_is_not_looked_through():
    thresholds, before = gc.get_threshold(), collections()
    with only_new_garbage(), only_new_garbage():
        last = [weakref.ref(Cycle()) for _ in range(1_500_000)][0]
        assert gc.get_threshold()[0] >= 50_000 and collections() == before
        assert last() is None, "what is new is looked through"
    assert gc.get_threshold() == thresholds


def test_blocks_that_overlap_restore_what_was_before():
    thresholds = gc.get_threshold()
    first, second = only_new_garbage(), only_new_garbage()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert gc.get_threshold() != thresholds
    second.__exit__(None, None, None)
    assert gc.get_threshold() == thresholds


def test_an_object_path_for_which_no_time_is_left_is_none(monkeypatch):
    """What ends the search within a step is no error of another kind."""
    monkeypatch.setattr("hmap_core.waypoints.plan._search", _out_of_time)
    with pytest.raises(NoObjectPath, match="none was looked at; the search ended with its time limit of 2 s"):
        plan_waypoints(many_parts.window(20, 20, 0), np.random.default_rng(0), 2.0)


def _out_of_time(*_):
    raise PlannerError("no time is left", Code.TIME_LIMIT)


@pytest.mark.parametrize("limit", [0.1, 0.3])
def test_transits_among_many_parts_keep_their_time_limit(limit):
    """By CPU time; it was up to sixteen times the limit."""
    scene, state, ends = many_parts.attached(PARTS, PARTS, 0)
    trial = many_parts.run_transit(scene, state, ends, limit)
    assert trial.cpu < 1.1 * limit + LONGEST


def test_a_base_of_many_pairs_is_packed_as_one_of_few(monkeypatch):
    model = grown.BaseModel()
    rng = np.random.default_rng(0)
    shapes = [model.add(f"s{k}", rng.normal(size=(5, 3)), 0.01 * k, k % 3) for k in range(6)]
    model.keep_apart(shapes[:3], shapes[3:], 0.01, 2)
    monkeypatch.setattr(grown, "MANY_PAIRS", 4)
    for name, packed, expected in zip(model.packed._fields, model.packed, CollisionModel.arrays(model), strict=True):
        assert packed.dtype == expected.dtype, name
        np.testing.assert_array_equal(packed, expected)


def test_many_pairs_are_made_and_solved_with_looks_at_the_clock(monkeypatch):
    """As many looks as there is work, by a clock that counts them."""
    scene, state, ends = many_parts.attached(PARTS, PARTS, 0)
    looks = []
    monkeypatch.setattr(deadline.time, "monotonic", lambda: looks.append(0) or float(len(looks)))
    counts = []
    for limit in (200.0, 400.0):
        looks.clear()
        with pytest.raises(MotionError, match=f"no motion of 'arm' was found within {limit:g} s"):
            planner.plan_motion(scene, "arm", T_world_ee=ends[0], state=state, time_limit=limit)
        counts.append(len(looks))
    assert counts[0] < 215 and counts[1] < 415


def test_processor_time_counts_within_its_block():
    with deadline.within_cpu_time(60.0):
        deadline.check_time()
        with deadline.within_cpu_time(-1.0):
            assert deadline.cpu_time_used_up()
            with deadline.within_cpu_time(60.0), pytest.raises(PlannerError, match="no time is left"):
                deadline.check_time()
        deadline.check_time()
    assert not deadline.cpu_time_used_up()


def test_without_a_time_limit_planning_takes_little_processor_time(monkeypatch):
    scene = load_scene("published/bolt", 0)
    monkeypatch.setattr(PLAN_MODULE, "DEFAULT_CPU_LIMIT", 0.02)
    with pytest.raises(PlannerError, match="no plan within the processor time.*; last: ") as error:
        planner.plan(scene, seed=0)
    assert error.value.code == Code.TIME_LIMIT
    assert planner.plan(scene, seed=0, time_limit=60.0).segments
