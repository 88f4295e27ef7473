"""Compiling in advance: once for a state of the sources, before the clock of a planning job starts."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from hmap_core import compile_cache
from hmap_core.compile_cache import ensure_compiled, mark_compiled


@pytest.fixture
def compilations(tmp_path, monkeypatch):
    """An empty cache; the commands that would have filled it."""
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv(compile_cache.JIT_DISABLED, raising=False)
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
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path / "file" / "cache"))
    texts = []
    ensure_compiled(texts.append)
    assert "cannot be compiled in advance" in texts[-1] and not compilations


def test_nothing_is_compiled_where_the_compiler_is_switched_off(compilations, monkeypatch):
    monkeypatch.setenv(compile_cache.JIT_DISABLED, "1")
    ensure_compiled()
    assert not compilations


def test_another_processor_needs_its_own(compilations, monkeypatch):
    ensure_compiled()
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    ensure_compiled()
    assert len(compilations) == 2
    assert len(os.listdir(os.environ[compile_cache.VARIABLE])) == 3  # two marks and the lock
