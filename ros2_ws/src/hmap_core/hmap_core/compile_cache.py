"""Cache of compiled code: one folder per state of the sources.

Numba detects changes in the file of a compiled function, but not in functions of other files that it calls. The folder
is therefore named by the hash of all compiled sources.
"""

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
JIT_DISABLED = "NUMBA_DISABLE_JIT"
KEPT_DAYS = 14  # age up to which folders are kept, since other checkouts on this machine may use them
COMPILED = (b"njit", b"cfunc", b"intrinsic", b"namedtuple")  # texts that mark a source with compiled code or types


def cache_root() -> Path:
    """Folder that contains the caches of all states of the sources."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "compiled"


@cache
def source_hash() -> str:
    """Hash of all sources of this package that contain compiled code or its types."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        source = file.read_bytes()
        if any(mark in source for mark in COMPILED):
            digest.update(file.relative_to(folder).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def use_own_cache() -> None:
    """Sets Numba's cache folder to the one of these sources, unless the user has set another one."""
    chosen = os.environ.get(VARIABLE)
    if chosen and cache_root() not in Path(chosen).parents:
        return
    folder = cache_root() / source_hash()
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # Numba has read the variable already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def ensure_compiled(report: Callable[[str], None] = lambda text: None) -> None:
    """Compile what planning needs, in a process of its own, unless that was done before on this kind of machine.

    Planning has a time limit, and compiling takes longer than that. If several processes begin at once, one compiles
    and the others wait for it. If it fails, the planner compiles what it meets, and is slow for that once.

    Args:
        report: called with what to tell the user, if there is something to do.
    """
    folder = Path(os.environ.get(VARIABLE) or cache_root() / source_hash())
    mark = folder / _mark_name()
    if mark.exists() or os.environ.get(JIT_DISABLED, "0") not in ("", "0"):
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "compiling.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed
            if not mark.exists():
                report("compiling the planner, once for this version: about a minute")
                subprocess.run([sys.executable, "-m", "hmap_core.precompile"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        report(f"the planner cannot be compiled in advance: {error}")


def mark_compiled() -> None:
    """Note in the cache that everything is compiled; see :func:`ensure_compiled`."""
    (Path(os.environ[VARIABLE]) / _mark_name()).touch()


def _mark_name() -> str:
    """Differs by what Numba's own cache differs by: where the sources are, versions, and the processor."""
    import llvmlite
    import numba
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    processor = get_host_cpu_name() + get_host_cpu_features().flatten()
    text = " ".join((__file__, sys.version, numba.__version__, llvmlite.__version__, processor))
    return f"compiled-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def remove_old_caches() -> None:
    """Deletes the folders of other states of the sources that have not changed for KEPT_DAYS."""
    current, oldest = source_hash(), time.time() - KEPT_DAYS * 86400
    for folder in cache_root().glob("*"):
        if folder.name != current and folder.stat().st_mtime < oldest:
            shutil.rmtree(folder, ignore_errors=True)
