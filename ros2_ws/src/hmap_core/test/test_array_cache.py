"""Arrays kept on disk: computed once, as computed, and anew where anything has changed or is damaged."""

import numpy as np
import pytest

from hmap_core import array_cache

ARRAYS = (np.linspace(0.0, 1.0, 7), np.array([[1, 2], [3, 4]]), np.array(0.5))


class Computation:
    """Counts how often it is called."""

    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        return ARRAYS


@pytest.fixture
def source(tmp_path, monkeypatch):
    """A source file, with an empty cache."""
    monkeypatch.setattr(array_cache, "cache_root", lambda: tmp_path / "cache")
    file = tmp_path / "source.py"
    file.write_text("1")
    return file


def get(source, computation, inputs=(b"a", b"b"), libraries=("numpy",)):
    found = array_cache.kept_arrays(str(source), inputs, libraries, computation)
    for array, expected in zip(found, ARRAYS, strict=True):
        assert array.dtype == expected.dtype and np.array_equal(array, expected)


def test_the_same_inputs_are_computed_once(source):
    computation = Computation()
    get(source, computation)
    get(source, computation)
    assert computation.calls == 1


@pytest.mark.parametrize("inputs", [(b"a",), (b"ab",), (b"", b"ab"), (b"b", b"a")])
def test_other_inputs_are_computed(source, inputs):
    computation = Computation()
    get(source, computation)
    get(source, computation, inputs)
    assert computation.calls == 2


def test_other_libraries_are_computed(source):
    computation = Computation()
    get(source, computation)
    get(source, computation, libraries=("numpy", "scipy"))
    assert computation.calls == 2


def test_a_change_of_the_source_computes_anew(source):
    computation = Computation()
    get(source, computation)
    source.write_text("2")
    get(source, computation)
    assert computation.calls == 2


@pytest.mark.parametrize("keep", [0, 10, 200])
def test_a_damaged_file_is_replaced(source, keep):
    computation = Computation()
    get(source, computation)
    (file,) = array_cache.cache_root().rglob("*.npy")
    file.write_bytes(file.read_bytes()[:keep])
    get(source, computation)
    get(source, computation)
    assert computation.calls == 2


def test_a_cache_that_cannot_be_written_is_done_without(source):
    array_cache.cache_root().write_text("a file where the folder should be")
    get(source, Computation())
