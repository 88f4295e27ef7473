"""Runs an executor in a thread, and ends it in an order in which callbacks under way still find all they need."""

import threading
from collections.abc import Callable
from contextlib import contextmanager

from rclpy.executors import Executor, ExternalShutdownException, MultiThreadedExecutor


class Spinner:
    """A thread that spins an executor from when it is made until :meth:`stop`."""

    def __init__(self, executor: Executor, on_error: Callable[[Exception], None]):
        """
        Args:
            on_error: called with what a callback raises; then the others go on.
        """
        self._executor, self._on_error = executor, on_error
        self._stopped = False
        self._limit = 0.0  # s of the present pause
        self._free = threading.Event()  # not paused
        self._free.set()
        self._thread = threading.Thread(target=self._spin, name="executor", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Take no more callbacks, wait for those under way, then shut the executor down.

        The other way round, as rclpy does it, a callback under way finds the executor's own handles destroyed.
        """
        self._stopped = True
        self._free.set()
        self._executor.wake()
        self._thread.join()
        if isinstance(self._executor, MultiThreadedExecutor):
            self._executor._executor.shutdown(wait=True)  # its pool of threads, which rclpy does not wait for
        self._executor.shutdown()

    @contextmanager
    def paused(self, limit: float):
        """Take no callbacks for the duration of a context, but for ``limit`` seconds at most.

        Who computes in this process then does not share the interpreter with the executor. What arrives waits.
        """
        self._limit = limit
        self._free.clear()
        self._executor.wake()
        try:
            yield
        finally:
            self._free.set()

    def _spin(self) -> None:
        while not self._stopped and self._executor.context.ok():
            try:
                if not self._free.wait(self._limit):
                    self._free.set()
                # what spin_until_future_complete does, but that keeps a callback of the future for each callback taken
                self._executor._spin_once_impl(None, lambda: self._stopped or not self._free.is_set())
            except ExternalShutdownException:
                return
            except Exception as error:
                self._on_error(error)
