"""Names what is wrong with messages once per cause, not once per message. Without ROS."""

import re
import threading
import time
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass

SOURCES_KEPT = 1000  # sources of which problems are remembered
FORGET_AFTER = 600.0  # s without a problem after which its count starts anew
ACTIVE_FOR = 5.0  # s after the last message with a problem during which it counts as present

_NUMBER = re.compile(r"(?<!\w)[-+]?(\d+(\.\d+)?([eE][-+]?\d+)?|nan|inf)(?!\w)")


def cause_of(problem: str) -> str:
    """The text of a problem without its numbers, which differ from message to message."""
    return _NUMBER.sub("#", problem)


@dataclass
class _Occurrence:
    """A problem of one source.

    Attributes:
        text: with the numbers of the last message.
        seen: when the problem occurred last, s of the steady clock.
        present: whether the last message had it.
        times: how often it has come back.
        named: whether this occasion was logged.
    """

    text: str
    seen: float
    present: bool = True
    times: int = 1
    named: bool = True


class ProblemLog:
    """Remembers the problems of each source.

    A problem is logged when it appears, not again while it persists, and again when it comes back. One that comes and
    goes is logged the first, second, fourth, eighth ... time that it comes back.

    Args:
        warn: logs a problem.
        inform: logs that a problem is over.
        now: returns the time in s.
    """

    def __init__(
        self, warn: Callable[[str], None], inform: Callable[[str], None], now: Callable[[], float] = time.monotonic
    ):
        self._warn, self._inform, self._now = warn, inform, now
        self._lock = threading.Lock()
        self._sources: dict[Hashable, dict[str, _Occurrence]] = {}  # source -> cause -> occurrence
        self._labels: dict[Hashable, str] = {}

    def update(self, source: Hashable, problems: Iterable[str], label: str = "") -> None:
        """Note what is wrong with the newest message of a source; no problems: it is as it should be.

        Args:
            source: from which it came, such as a topic.
            problems: a sentence each.
            label: of the source, for the log; default: the source itself.
        """
        given = {cause_of(text): text for text in problems}
        with self._lock:
            known = self._sources.get(source)
            if not given and not known:
                return
            if known is None:
                known = self._sources[source] = {}
                while len(self._sources) > SOURCES_KEPT:
                    oldest = next(iter(self._sources))
                    del self._sources[oldest]
                    self._labels.pop(oldest, None)
            self._labels[source] = label or str(source)
            now = self._now()
            news = [self._appear(source, known, cause, text, now) for cause, text in given.items()]
            news += [self._heal(source, known, cause) for cause in known.keys() - given.keys()]
            for cause in [c for c, entry in known.items() if not entry.present and now - entry.seen > FORGET_AFTER]:
                del known[cause]
        for write, text in filter(None, news):
            write(text)

    def active(self) -> list[str]:
        """The problems of now, with their sources."""
        with self._lock:
            recent = self._now() - ACTIVE_FOR
            return [
                f"{self._labels[source]}: {entry.text}"
                for source, entries in self._sources.items()
                for entry in entries.values()
                if entry.present and entry.seen >= recent
            ]

    def _appear(
        self, source: Hashable, known: dict[str, _Occurrence], cause: str, text: str, now: float
    ) -> tuple[Callable[[str], None], str] | None:
        entry = known.get(cause)
        if entry is None:
            known[cause] = _Occurrence(text, now)
            return self._warn, f"{self._labels[source]}: {text}"
        back = not entry.present
        entry.text, entry.seen, entry.present = text, now, True
        if not back:
            return None
        entry.times += 1
        entry.named = entry.times & (entry.times - 1) == 0  # a power of two
        again = f" (for the {entry.times}. time)"
        return (self._warn, f"{self._labels[source]}: {text}{again}") if entry.named else None

    def _heal(
        self, source: Hashable, known: dict[str, _Occurrence], cause: str
    ) -> tuple[Callable[[str], None], str] | None:
        entry = known[cause]
        was, entry.present = entry.present, False
        if not was or not entry.named:
            return None
        return self._inform, f"{self._labels[source]}: no longer so: {entry.text}"
