"""A plan of a small task while a node waits, so that its first request finds everything loaded."""

import contextlib
import os
import threading
from collections.abc import Callable

from hmap_core import planner
from hmap_core.exceptions import HmapError
from hmap_core.scenes import load_scene

TASK, SEED, LIMIT = "tunnel", 0, 60.0  # s
NICENESS = 19  # of the thread, so that nodes which start have priority


class WarmUp:
    """Plans in a thread of its own, until it is done or somebody needs the node."""

    def __init__(self, tell: Callable[[str], None]):
        """
        Args:
            tell: called once it is done.
        """
        self._tell, self._needed = tell, threading.Event()
        self._thread = threading.Thread(target=self._plan, name="warm_up", daemon=True)
        self._thread.start()

    def end(self, wait: bool = False) -> None:
        """End it.

        Args:
            wait: until it has ended.
        """
        self._needed.set()
        if wait:
            self._thread.join()

    def _plan(self) -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        with contextlib.suppress(HmapError):  # canceled, or slow on a busy machine
            planner.plan(load_scene(TASK, SEED), seed=SEED, time_limit=LIMIT, cancel=self._needed.is_set)
            self._tell("warmed up")
