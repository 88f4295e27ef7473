"""Runs an executor in a thread, and ends it in an order in which callbacks under way still find all they need."""

import threading
from collections.abc import Callable

from rclpy.executors import Executor, ExternalShutdownException, MultiThreadedExecutor
from rclpy.task import Future


class Spinner:
    """A thread that spins an executor from when it is made until :meth:`stop`."""

    def __init__(self, executor: Executor, on_error: Callable[[Exception], None]):
        """
        Args:
            on_error: called with what a callback raises; then the others go on.
        """
        self._executor, self._on_error = executor, on_error
        self._stopped = Future()
        self._thread = threading.Thread(target=self._spin, name="executor", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Take no more callbacks, wait for those under way, then shut the executor down.

        The other way round, as rclpy does it, a callback under way finds the executor's own handles destroyed.
        """
        self._stopped.set_result(None)
        self._thread.join()
        if isinstance(self._executor, MultiThreadedExecutor):
            self._executor._executor.shutdown(wait=True)  # its pool of threads, which rclpy does not wait for
        self._executor.shutdown()

    def _spin(self) -> None:
        while not self._stopped.done():
            try:
                self._executor.spin_until_future_complete(self._stopped)
            except ExternalShutdownException:
                return
            except Exception as error:
                self._on_error(error)
