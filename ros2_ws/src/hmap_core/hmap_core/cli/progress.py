"""Live progress on standard error: one updated line on a terminal, otherwise one line for each change."""

import sys
import threading
import time
from typing import TextIO

MIN_PERIOD = 0.1  # s between two updates on a terminal
LINE_PERIOD = 1.0  # s between two lines of the same phase without a terminal
MAX_WIDTH = 110  # characters


class ProgressLine:
    """Shows the current phase. It is a context manager that clears its line on a terminal at the end.

    Args:
        stream: where to write; default: standard error.
    """

    def __init__(self, stream: TextIO | None = None):
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._began = time.monotonic()
        self._shown, self._phase, self._last = "", "", -float("inf")
        self._lock = threading.Lock()

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(self, *_) -> None:
        self.clear()

    def clear(self) -> None:
        """Leave a terminal clean for what is printed next."""
        if self._terminal and self._shown:
            self._stream.write("\r\033[K")
            self._stream.flush()

    def show(self, phase: str, text: str = "") -> None:
        """Show a phase and its current step; updates that are too fast to read are dropped."""
        with self._lock:
            now = time.monotonic()
            line = f"{phase}: {text}" if text else phase
            period = MIN_PERIOD if self._terminal else LINE_PERIOD
            if line == self._shown or (phase == self._phase and now - self._last < period):
                return
            self._shown, self._phase, self._last = line, phase, now
            stamped = f"[{now - self._began:6.1f} s] {line}"[:MAX_WIDTH]
            self._stream.write(f"\r\033[K{stamped}" if self._terminal else f"{stamped}\n")
            self._stream.flush()

    def note(self, text: str) -> None:
        """Write a line that stays, whatever is shown afterwards."""
        with self._lock:
            start = "\r\033[K" if self._terminal else ""
            self._stream.write(f"{start}[{time.monotonic() - self._began:6.1f} s] {text}\n")
            self._stream.flush()
            self._shown, self._last = "", -float("inf")

    def planning(self, phase: str, waypoint: int, waypoints: int, attempt: int, text: str = "") -> None:
        """Show the state of Algorithm 1.

        Args:
            phase: name of the phase.
            waypoint: number of the current waypoint, from 1.
            waypoints: number of waypoints; 0: not known yet.
            attempt: number of the contact that is tried, from 1; 0: none yet.
            text: further text.
        """
        parts = [f"waypoint {waypoint} of {waypoints}"] if waypoints else []
        parts += [f"try {attempt}"] if attempt else []
        parts += [text] if text else []
        self.show(phase, ", ".join(parts))
