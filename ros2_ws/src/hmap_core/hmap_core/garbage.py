"""Python's garbage collection, made for short processes that import much."""

import atexit
import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

NEVER = 2**31 - 1  # collections of the younger objects between two of all
THRESHOLD = 50_000  # objects made, and not deleted, between two collections; Python's is 700

_LOCK = threading.Lock()
_BLOCKS: list[tuple[int, int, int]] = []  # for each block of only_new_garbage, the thresholds outside of all


def collect_rarely() -> None:
    """Makes the collector run rarely, and not when the process ends.

    Imports and compiled functions make some million objects that all stay; to look through them time and again takes
    a fifth of the time to start, and as long again to end.
    """
    gc.set_threshold(THRESHOLD)
    atexit.register(gc.freeze)


@contextmanager
def only_new_garbage() -> Iterator[None]:
    """Within this block the collector runs rarely, and never through all objects: only through those made since.

    A look through all that was imported takes 0.1 s, for which a time limit has no room.
    Blocks may overlap, in threads.
    """
    with _LOCK:
        young, middle, full = _BLOCKS[0] if _BLOCKS else gc.get_threshold()
        _BLOCKS.append((young, middle, full))
        gc.set_threshold(max(THRESHOLD, young), middle, NEVER)
    try:
        yield
    finally:
        with _LOCK:
            thresholds = _BLOCKS.pop()
            if not _BLOCKS:
                gc.set_threshold(*thresholds)
