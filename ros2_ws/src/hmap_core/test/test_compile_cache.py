"""Compiled code: made once for a content of the sources, before the clock of a planning job starts."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hmap_core import compile_cache
from hmap_core.cache_locator import ContentLocator
from hmap_core.compile_cache import ensure_compiled, mark_compiled


@pytest.fixture
def compilations(tmp_path, monkeypatch):
    """An empty cache; the commands that would have filled it."""
    monkeypatch.setattr(compile_cache, "cache_root", lambda: tmp_path / "cache")
    monkeypatch.delenv(compile_cache.NUMBA_OFF, raising=False)
    commands = []

    def run(command, **options):
        commands.append(command)
        mark_compiled()

    monkeypatch.setattr(compile_cache.subprocess, "run", run)
    return commands


def test_compiles_once(compilations):
    texts = []
    ensure_compiled(texts.append)
    ensure_compiled(texts.append)
    assert compilations == [[sys.executable, "-m", "hmap_core.precompile"]]
    assert len(texts) == 1 and "once" in texts[0]


def test_processes_that_start_together_compile_once(compilations):
    with ThreadPoolExecutor(4) as pool:  # a lock on a file of its own handle works between threads, too
        list(pool.map(lambda _: ensure_compiled(), range(4)))
    assert len(compilations) == 1


def test_a_failure_is_reported_and_planning_goes_on(compilations, monkeypatch):
    def fail(command, **options):
        raise subprocess.CalledProcessError(1, command)

    monkeypatch.setattr(compile_cache.subprocess, "run", fail)
    texts = []
    ensure_compiled(texts.append)
    assert "cannot be compiled in advance" in texts[-1]


def test_a_cache_that_cannot_be_written_is_reported(compilations, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(compile_cache, "cache_root", lambda: tmp_path / "file" / "cache")
    texts = []
    ensure_compiled(texts.append)
    assert "cannot be compiled in advance" in texts[-1] and not compilations


def test_nothing_is_compiled_where_the_compiler_is_switched_off(compilations, monkeypatch):
    monkeypatch.setenv(compile_cache.NUMBA_OFF, "1")
    ensure_compiled()
    assert not compilations


def test_another_processor_needs_its_own(compilations, monkeypatch):
    ensure_compiled()
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    monkeypatch.setattr(compile_cache, "_compiler", compile_cache._compiler.__wrapped__)  # as in another process
    ensure_compiled()
    assert len(compilations) == 2


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package: the code of one module calls that of another, which uses a constant of a third."""
    folder = tmp_path / "checkout" / "hmap_core"
    (folder / "deep").mkdir(parents=True)
    (folder / "constants.py").write_text("STEP = 1\n")
    (folder / "deep" / "inner.py").write_text("from hmap_core.constants import STEP\n# njit\n")
    (folder / "outer.py").write_text("from hmap_core.deep import (\n    inner,\n)\n# njit\n")
    (folder / "other.py").write_text("# njit\n")
    monkeypatch.setattr(compile_cache, "PACKAGE", folder)
    return folder


def hashes(folder):
    for function in (compile_cache.module_hash, compile_cache._imports, compile_cache._has_compiled_code):
        function.cache_clear()
    return [compile_cache.module_hash(folder / name) for name in ("deep/inner.py", "outer.py", "other.py")]


@pytest.mark.parametrize("changed", ["deep/inner.py", "constants.py"])
def test_a_change_invalidates_what_depends_on_it_and_nothing_else(package, changed):
    before = hashes(package)
    (package / changed).write_text((package / changed).read_text() + "# changed\n")
    after = hashes(package)
    assert [a == b for a, b in zip(before, after, strict=True)] == [False, False, True]


def test_checkouts_share_the_cache(package, tmp_path, monkeypatch):
    before = hashes(package)
    moved = package.parent.rename(tmp_path / "another") / "hmap_core"
    monkeypatch.setattr(compile_cache, "PACKAGE", moved)
    assert hashes(moved) == before


def test_a_function_of_another_package_is_left_to_numba():
    assert ContentLocator.from_function(pytest.fixture, pytest.__file__) is None


def test_compiled_code_is_found_again(tmp_path):
    """A second process loads what the first has compiled."""
    script = (
        "import hmap_core.collision.simplex as module;"
        "from numba.core.dispatcher import Dispatcher;"
        "function = next(f for f in vars(module).values() if isinstance(f, Dispatcher) and f.signatures == []);"
        "print(function._cache.cache_path)"
    )
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    for name in (compile_cache.NUMBA_FOLDER, compile_cache.NUMBA_LOCATORS):
        environment.pop(name, None)
    run = subprocess.run([sys.executable, "-c", script], env=environment, text=True, capture_output=True, check=True)
    simplex = Path(compile_cache.__file__).parent / "collision" / "simplex.py"
    compile_cache.module_hash.cache_clear()
    assert Path(run.stdout.strip()) == tmp_path / "hmap" / "compiled" / compile_cache.module_hash(simplex)
