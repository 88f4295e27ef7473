"""Cache of compiled code: by the contents of the sources, not by where they are.

Numba detects changes in the file of a compiled function, but not in functions of other files that it calls, and it
keeps a cache for each path. Here the key is the content of a module and of all modules with compiled code that it
imports, directly or not. So checkouts share the cache, and after a change only what depends on it is compiled again.
"""

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

NUMBA_FOLDER = "NUMBA_CACHE_DIR"  # variables of Numba
NUMBA_LOCATORS = "NUMBA_CACHE_LOCATOR_CLASSES"
NUMBA_OFF = "NUMBA_DISABLE_JIT"
OWN_LOCATOR = "hmap_core.cache_locator.ContentLocator"
NUMBA_LOCATORS_OF_OTHERS = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "ZipCacheLocator")
KEPT_DAYS = 14  # age up to which folders are kept, since other checkouts on this machine may use them
COMPILED = (b"njit", b"cfunc", b"intrinsic", b"namedtuple")  # texts that mark a source with compiled code or types
PACKAGE = Path(__file__).parent
# Only absolute imports: the sources have no others. An expression, as a parser would take a quarter of a second.
IMPORT = re.compile(rf"^\s*(?:from|import) ({PACKAGE.name}[\w.]*)(?: import (\([^)]*\)|[^\n]*))?", re.MULTILINE)


def cache_root() -> Path:
    """Folder that contains the caches of all states of the sources."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "compiled"


def is_own(file: Path) -> bool:
    """Whether a source belongs to this package."""
    return PACKAGE in file.parents


@cache
def module_hash(file: Path) -> str:
    """Hash of a source of this package and of what its compiled code depends on.

    These are all sources with compiled code that it imports, directly or not, and what they import themselves: Numba
    compiles constants in.
    """
    compiled = {file} | {path for path in _imported(file) if _has_compiled_code(path)}
    return _hash(compiled.union(*map(_imports, compiled)))


@cache
def source_hash() -> str:
    """Hash of all sources of this package that contain compiled code or its types."""
    return _hash(filter(_has_compiled_code, PACKAGE.rglob("*.py")))


def _hash(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.relative_to(PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _has_compiled_code(file: Path) -> bool:
    source = file.read_bytes()
    return any(mark in source for mark in COMPILED)


def _imported(file: Path) -> set[Path]:
    """A source and all sources of this package that it imports, directly or not."""
    found, todo = set(), [file]
    while todo:
        path = todo.pop()
        if path not in found:
            found.add(path)
            todo += _imports(path)
    return found


@cache
def _imports(file: Path) -> tuple[Path, ...]:
    """Sources of this package that a source imports."""
    files = []
    for module, names in IMPORT.findall(file.read_text()):
        base = PACKAGE.parent.joinpath(*module.split("."))
        files += [base, *(base / name for name in re.findall(r"\w+", names))]
    candidates = (path for base in files for path in (base.with_suffix(".py"), base / "__init__.py"))
    return tuple(path for path in candidates if path.exists())


def use_own_cache() -> None:
    """Lets Numba look for code of this package by content, unless the user has chosen how it looks."""
    if os.environ.get(NUMBA_LOCATORS) or os.environ.get(NUMBA_FOLDER):
        return
    os.environ[NUMBA_LOCATORS] = ",".join((OWN_LOCATOR, *NUMBA_LOCATORS_OF_OTHERS))
    if "numba" in sys.modules:  # Numba has read the variable already
        sys.modules["numba"].config.CACHE_LOCATOR_CLASSES = os.environ[NUMBA_LOCATORS]


def ensure_compiled(report: Callable[[str], None] = lambda text: None) -> None:
    """Compile what planning needs, in a process of its own, unless that was done before on this kind of machine.

    Planning has a time limit, and compiling takes longer than that. If several processes begin at once, one compiles
    and the others wait for it. If it fails, the planner compiles what it meets, and is slow for that once.

    Args:
        report: called with what to tell the user, if there is something to do.
    """
    mark = _mark()
    if mark.exists() or os.environ.get(NUMBA_OFF, "0") not in ("", "0"):
        return
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        with mark.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed
            if not mark.exists():
                report("compiling the planner, once for this version: about a minute")
                subprocess.run([sys.executable, "-m", "hmap_core.precompile"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        report(f"the planner cannot be compiled in advance: {error}")


def mark_compiled() -> None:
    """Note in the cache that everything is compiled; see :func:`ensure_compiled`."""
    _mark().parent.mkdir(parents=True, exist_ok=True)
    _mark().touch()


def _mark() -> Path:
    """Differs by what Numba's cache differs by: the sources, versions, and the processor."""
    text = f"{os.environ.get(NUMBA_FOLDER, '')} {_compiler()}"  # the user's own folder
    return cache_root() / source_hash() / f"compiled-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


@cache
def _compiler() -> str:
    """Versions of the compiler, and the processor that it compiles for; asked once, as that takes a millisecond."""
    import llvmlite
    import numba
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    processor = get_host_cpu_name() + get_host_cpu_features().flatten()
    return " ".join((sys.version, numba.__version__, llvmlite.__version__, processor))


def remove_old_caches() -> None:
    """Deletes the folders of other states of the sources that have not changed for KEPT_DAYS."""
    current = {source_hash(), *(module_hash(file) for file in PACKAGE.rglob("*.py"))}
    oldest = time.time() - KEPT_DAYS * 86400
    for folder in cache_root().glob("*"):
        if folder.name not in current and folder.stat().st_mtime < oldest:
            shutil.rmtree(folder, ignore_errors=True)
