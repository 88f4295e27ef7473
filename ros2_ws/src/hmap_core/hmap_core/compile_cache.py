"""Cache of compiled code: one folder per state of the sources.

Numba detects changes in the file of a compiled function, but not in functions of other files that it calls. The folder
is therefore named by the hash of all compiled sources.
"""

import hashlib
import os
import shutil
import sys
import time
from functools import cache
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
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


def remove_old_caches() -> None:
    """Deletes the folders of other states of the sources that have not changed for KEPT_DAYS."""
    current, oldest = source_hash(), time.time() - KEPT_DAYS * 86400
    for folder in cache_root().glob("*"):
        if folder.name != current and folder.stat().st_mtime < oldest:
            shutil.rmtree(folder, ignore_errors=True)
