"""Which machine and which versions a table was made with."""

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from hmap_core import __version__
from hmap_core.planner import plugins

PACKAGES = ("numpy", "scipy", "numba", "coal", "ompl", "pybullet")  # whose versions decide about results
CPU_INFO = Path("/proc/cpuinfo")


def describe() -> str:
    """This machine, as text."""
    return f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}"


def session(planners: Sequence[str], jobs: int, dask: str | None) -> dict[str, Any]:
    """Describe a run, as plain JSON types.

    Args:
        planners: names of the methods.
        jobs: number of trials at once; -1 for one on each core.
        dask: address of the scheduler, if there is one; its workers' machines are not known yet.
    """
    known = plugins.plugins(plugins.PLANNERS)
    origins = {name: known[name.partition(":")[0]] for name in planners}
    return {
        "machine": describe(),
        "jobs": dask or (os.cpu_count() if jobs < 0 else jobs),
        "python": platform.python_version(),
        "versions": {"hmap_core": __version__} | {name: _version(name) for name in PACKAGES},
        "planners": {name: f"{plugin.origin} {plugin.version}".strip() for name, plugin in origins.items()},
    }


def _processor() -> str:
    try:
        lines = CPU_INFO.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
