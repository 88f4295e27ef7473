"""The times of a bag never go back, whatever the clock does."""

from hmap.nodes.recorder import ContinuousTime


def test_times_go_on_when_a_simulation_is_started_anew():
    bag = ContinuousTime()
    assert [bag.of(now) for now in (0, 5, 9, 9)] == [0, 5, 9, 9]
    assert bag.offset == 0
    assert [bag.of(now) for now in (1, 2, 4)] == [9, 10, 12]
    assert bag.offset == 8
    assert [bag.of(now) for now in (0, 3)] == [12, 15]
