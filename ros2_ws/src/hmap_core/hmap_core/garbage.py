"""Python's garbage collection, made for short processes that import much."""

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager

THRESHOLD = 50_000  # objects made, and not deleted, between two collections; Python's is 700


def collect_rarely() -> None:
    """Makes the collector run rarely, and not when the process ends.

    Imports and compiled functions make some million objects that all stay; to look through them time and again takes
    a fifth of the time to start, and as long again to end.
    """
    gc.set_threshold(THRESHOLD)
    atexit.register(gc.freeze)


@contextmanager
def only_new_garbage() -> Iterator[None]:
    """Within this block the collector runs rarely, and looks through objects that are made in it and no others.

    A look through all that was imported takes 0.1 s, for which a time limit has no room. What was set aside by someone
    else stays so.
    """
    aside, thresholds = gc.get_freeze_count() == 0, gc.get_threshold()
    if aside:
        gc.freeze()
    gc.set_threshold(max(THRESHOLD, thresholds[0]), *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        if aside:
            gc.unfreeze()
