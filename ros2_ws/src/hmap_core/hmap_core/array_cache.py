"""Arrays that take long to compute, kept on disk under a hash of what they are computed from."""

import hashlib
import os
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from hmap_core.compile_cache import cache_root, source_hash

Arrays = tuple[np.ndarray, ...]


def kept_arrays(
    source: str, inputs: Iterable[bytes], libraries: Iterable[str], compute: Callable[[], Arrays]
) -> Arrays:
    """Arrays from the cache, or computed and put there.

    Args:
        source: the file that holds the computation; a change of it, or of any compiled function, computes anew.
        inputs: all that the arrays depend on beside it.
        libraries: distributions whose version they depend on, too.
        compute: returns the arrays; not called where they are in the cache.

    Returns:
        The arrays, to the last bit as they were computed.
    """
    key = hashlib.sha256(Path(source).read_bytes())
    for part in (*(_release(name) for name in libraries), *inputs):
        key.update(len(part).to_bytes(8, "little") + part)
    file = cache_root() / source_hash() / "arrays" / f"{key.hexdigest()[:32]}.npy"
    try:
        return _read(file)
    except (OSError, ValueError, EOFError):  # not there, or damaged
        arrays = compute()
    _write(file, arrays)
    return arrays


@cache
def _release(library: str) -> bytes:
    """Name and version of a distribution; looking it up takes longer than reading an array."""
    return f"{library} {version(library)}".encode()


def _read(file: Path) -> Arrays:
    with file.open("rb") as stream:
        count = int(np.load(stream))
        return tuple(np.load(stream) for _ in range(count))


def _write(file: Path, arrays: Arrays) -> None:
    draft = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("wb") as stream:
            for array in (np.array(len(arrays)), *arrays):
                np.save(stream, array, allow_pickle=False)
        os.replace(draft, file)  # at once, so that another process never sees half of it
    except OSError:  # a cache that cannot be written only costs time
        pass
