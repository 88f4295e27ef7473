"""Segments of dead processes are removed, those of living and of starting ones are not."""

import fcntl
import os
import time

import pytest

from hmap.launcher.shared_memory import STARTING, remove_dead_segments

SIZE = 1000


@pytest.fixture
def segment(tmp_path):
    """Makes a segment with its lock; returns both."""

    def make(name: str, age: float = 2.0 * STARTING):
        files = tmp_path / name, tmp_path / f"{name}_el"
        files[0].write_bytes(bytes(SIZE))
        files[1].touch()
        os.utime(files[1], (time.time() - age,) * 2)
        return files

    return make


def test_a_segment_that_nobody_holds_is_removed_with_its_lock(segment, tmp_path):
    segment("fastrtps_0123456789abcdef")
    assert remove_dead_segments(tmp_path) == SIZE
    assert not list(tmp_path.iterdir())


def test_segments_of_living_and_starting_processes_and_ports_stay(segment, tmp_path):
    living = segment("fastrtps_0123456789abcdef")
    segment("fastrtps_fedcba9876543210", age=0.5 * STARTING)
    segment("fastrtps_port7411")
    with living[1].open() as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        assert remove_dead_segments(tmp_path) == 0
    assert len(list(tmp_path.iterdir())) == 6


def test_a_lock_without_its_segment_is_removed(segment, tmp_path):
    segment("fastrtps_0123456789abcdef")[0].unlink()
    assert remove_dead_segments(tmp_path) == 0
    assert not list(tmp_path.iterdir())


def test_a_machine_without_shared_memory_has_no_segments(tmp_path):
    assert remove_dead_segments(tmp_path / "none") == 0
