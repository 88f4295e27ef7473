"""Python's garbage collection, made for short processes that import much."""

import atexit
import gc

THRESHOLD = 50_000  # objects made, and not deleted, between two collections; Python's is 700


def collect_rarely() -> None:
    """Makes the collector run rarely, and not when the process ends.

    Imports and compiled functions make some million objects that all stay; to look through them time and again takes
    a fifth of the time to start, and as long again to end.
    """
    gc.set_threshold(THRESHOLD)
    atexit.register(gc.freeze)
