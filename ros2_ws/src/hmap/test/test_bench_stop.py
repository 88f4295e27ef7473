"""How long arms move on is read from joint states: the last time at which a joint is not where it comes to rest."""

import time

import numpy as np
import pytest

from hmap.commands import bench_stop


def samples(speed: float, until: float, end: float, began: float = 0.0):
    """A joint moves at a speed (rad/s) until a time; measured every 10 ms until the end."""
    return [(began + t, np.array([0.3, speed * min(t, until)])) for t in np.arange(0.0, end, 0.01)]


def test_the_time_until_arms_rest():
    moves = samples(0.5, 1.2, 3.0)
    assert bench_stop.rest_after(moves, 1.0) == pytest.approx(0.2, abs=0.02)
    assert bench_stop.rest_after(moves, 2.0) == 0.0


def test_the_speed_of_the_fastest_joint():
    now = time.monotonic()
    assert bench_stop.fastest(samples(-0.5, 9.0, 0.5, now - 0.5)) == pytest.approx(0.5, rel=0.1)
    assert bench_stop.fastest(samples(0.5, 0.1, 0.5, now - 0.5)) == 0.0 == bench_stop.fastest([])


def test_the_table_has_a_line_for_each_way_to_stop():
    found = {kind: {"rest_s": [0.1, 0.4, 0.2], "speed_rad_s": [1.0, 2.0, 3.0]} for kind in bench_stop.KINDS}
    head, *rows = bench_stop.lines(found)
    assert len(rows) == len(bench_stop.KINDS) and all(row.split()[-4:] == ["0.20", "0.40", "2.00", "3"] for row in rows)
