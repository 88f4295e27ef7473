"""Where compiled code is kept: one folder per state of the sources.

Numba notices a change in the file of a compiled function, but not in the functions that it calls in other files. A
folder named by the hash of all of them makes sure that what runs is what is written.
"""

import hashlib
import os
import shutil
import sys
import time
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
KEPT_DAYS = 14  # other checkouts on this machine may still run with theirs
COMPILED = (b"njit", b"cfunc", b"intrinsic", b"namedtuple")  # marks of a source whose code or types are compiled


def cache_root() -> Path:
    """Folder of all caches of compiled code."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "compiled"


def source_hash() -> str:
    """Hash of the sources of this package that are compiled, or whose types are."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        source = file.read_bytes()
        if any(mark in source for mark in COMPILED):
            digest.update(file.relative_to(folder).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def use_own_cache() -> None:
    """Points numba at the folder for these sources, unless the user has chosen one."""
    chosen = os.environ.get(VARIABLE)
    if chosen and cache_root() not in Path(chosen).parents:
        return
    folder = cache_root() / source_hash()
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read the variable already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def remove_old_caches() -> None:
    """Deletes folders of other states of the sources that nothing was added to for a while."""
    current, oldest = source_hash(), time.time() - KEPT_DAYS * 86400
    for folder in cache_root().glob("*"):
        if folder.name != current and folder.stat().st_mtime < oldest:
            shutil.rmtree(folder, ignore_errors=True)
