"""Differences between sets of runs are found where there are any, and nothing is concluded from too few runs."""

import numpy as np
import pytest

from hmap_core.evaluation.comparison import DIFFERS, SAME, TOO_FEW, compare, table
from hmap_core.evaluation.intervals import mean_interval, permutation_p, smallest_p, wilson
from hmap_core.evaluation.recorded import RunMetrics


def runs(times, first_seed: int = 0, task: str = "tunnel", outcome: str = "solved") -> list[RunMetrics]:
    seeds = range(first_seed, first_seed + len(times))
    pairs = zip(seeds, times, strict=True)
    return [RunMetrics("", 1, task, k, outcome, execution_s=float(t), replans=0) for k, t in pairs]


def verdict(a, b, name: str = "execution_s"):
    return next(d for d in compare(a, b) if d.name == name)


def times(count: int, seed: int, scale: float = 1.0) -> np.ndarray:
    return scale * np.random.default_rng(seed).normal(20.0, 1.0, count)


def test_a_slower_set_is_found_and_by_how_much():
    found = verdict(runs(times(10, 1)), runs(times(10, 2, 1.2), 100))
    assert found.verdict == DIFFERS and not found.paired and found.n_a == found.n_b == 10
    assert found.ratio == pytest.approx(1.2, abs=0.05) and found.low < 4.0 < found.high
    assert verdict(runs(times(10, 1)), runs(times(10, 2), 100)).verdict == SAME


def test_five_runs_each_are_enough_for_a_clear_difference():
    assert verdict(runs(times(5, 1)), runs(times(5, 2, 1.2), 100)).verdict == DIFFERS


@pytest.mark.parametrize("count", [1, 2, 4])
def test_nothing_is_concluded_from_too_few_runs(count):
    found = verdict(runs(times(count, 1)), runs(times(count, 2, 3.0)))
    assert found.verdict == TOO_FEW and found.p is None and found.low is None
    assert "too few runs to tell" in "\n".join(table([found]))


def test_runs_with_the_same_seeds_are_compared_with_each_other():
    """Tasks differ much more from seed to seed than the sets do."""
    base = np.random.default_rng(3).uniform(5.0, 60.0, 10)
    noise = np.random.default_rng(4).normal(0.0, 0.2, 10)
    found = verdict(runs(base), runs(base * 1.05 + noise))
    assert found.paired and found.n_a == 10 and found.verdict == DIFFERS
    other = verdict(runs(base), runs(base * 1.05 + noise, 100))
    assert not other.paired and other.verdict == SAME


def test_numbers_that_one_set_lacks_are_left_out():
    a = runs(times(6, 1))
    b = [RunMetrics("bag", 1, "tunnel", k, "solved") for k in range(6)]
    assert {d.name for d in compare(a, b)} == {"solved", "contact_switches", "replans"} - {"contact_switches"}


def test_success_is_compared_as_well():
    found = verdict(runs(times(10, 1)), runs(times(10, 1), 50, outcome="failed"), "solved")
    assert found.verdict == DIFFERS and found.a == 1.0 and found.b == 0.0


def test_intervals_and_p_values():
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-3)
    assert wilson(5, 10)[0] == pytest.approx(0.2366, abs=1e-3)
    low, high = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert 1.5 < low < 3.0 < high < 4.5
    a, b = np.arange(5.0), np.arange(5.0) + 100.0
    assert permutation_p(a, b, False) == pytest.approx(smallest_p(5, 5, False)) == pytest.approx(2 / 252)
    assert permutation_p(a, b, True) == pytest.approx(smallest_p(5, 5, True)) == pytest.approx(2 / 32)
    assert permutation_p(a, a, False) == 1.0
    many = np.random.default_rng(0).normal(size=(2, 40))
    assert 0.0 < permutation_p(many[0], many[1] + 3.0, False) < 0.001
