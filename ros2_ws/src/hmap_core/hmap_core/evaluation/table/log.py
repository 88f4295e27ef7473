"""The log of a table's trials: one JSON line for each, flushed to the disk, so that a run that is killed resumes."""

import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from hmap_core.evaluation.trial import Trial, TrialResult
from hmap_core.exceptions import InputError

TRIALS = "trials.jsonl"
# of a trial, what has to be the same in a whole log
SETTINGS = ("time_limit", "max_replans", "engine")

Key = tuple[str, str, int]  # task, planner, seed


def key_of(trial: Trial) -> Key:
    """What tells a trial of a table from the others."""
    return trial.task, trial.planner, trial.seed


class TrialLog:
    """The finished trials of a table in a folder; use it in a ``with``, which keeps a second run out.

    Args:
        folder: where the files are.

    Attributes:
        results: of the finished trials.
        sessions: the runs that wrote to the log, each with its machine, versions, when it ``began``, and ``seconds``
            until its last trial ended.
    """

    def __init__(self, folder: Path):
        self.file = folder / TRIALS
        self.results: dict[Key, TrialResult] = {}
        self.sessions: list[dict[str, Any]] = []
        self._settings: dict[str, Any] = {}
        self._stream: IO[bytes] | None = None

    @contextmanager
    def opened(self, session: dict[str, Any], wanted: list[Trial]) -> Iterator["TrialLog"]:
        """Read what is there, and open the log for new trials.

        Args:
            session: describes this run: machine, versions.
            wanted: the trials of the table.

        Raises:
            InputError: another run writes to the log, it is none, or its trials have other settings.
        """
        with self.file.open("ab+") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise InputError(
                    f"{self.file}: another run writes to it; wait for its end, or use another --out"
                ) from error
            self._stream = stream
            self._read(stream)
            for trial in wanted:
                self._check_settings({name: getattr(trial, name) for name in SETTINGS})
            self.sessions.append({"began": time.time(), "host": socket.gethostname(), **session, "seconds": 0.0})
            yield self
        self._stream = None

    def add(self, trial: Trial, result: TrialResult) -> None:
        """Append a finished trial; it is on the disk when this returns.

        Raises:
            ValueError: the log is not open, or has the trial already.
        """
        if self._stream is None or key_of(trial) in self.results:
            raise ValueError(f"{key_of(trial)}: the log is not open, or has this trial already")
        own, ended = self.sessions[-1], time.time()
        own["seconds"] = ended - own["began"]
        line = {"trial": asdict(trial), "result": result.to_dict(), "session": own}
        self._stream.write(json.dumps(line).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self.results[key_of(trial)] = result

    def describe(self, **more: Any) -> None:
        """Add to the description of this run what is known only later."""
        self.sessions[-1].update(more)

    def _read(self, stream: IO[bytes]) -> None:
        """Read all whole lines; a last one that a kill cut off is removed, and its trial run again."""
        stream.seek(0)
        data = stream.read()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            stream.truncate(whole)
        for number, line in enumerate(data[:whole].splitlines(), 1):
            self._read_line(line, number)

    def _read_line(self, line: bytes, number: int) -> None:
        try:
            entry = json.loads(line)
            trial, given, session = Trial(**entry["trial"]), entry["result"], dict(entry["session"])
            result = TrialResult(**given | {"replan_reasons": tuple(given.get("replan_reasons", ()))})
            began = float(session["began"])
            session["seconds"] = float(session["seconds"])
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{self.file}:{number}: no trial of this version ({type(error).__name__}: {error}); use another --out"
            ) from error
        self._check_settings({name: getattr(trial, name) for name in SETTINGS})
        self.results.setdefault(key_of(trial), result)
        if self.sessions and self.sessions[-1]["began"] == began:
            self.sessions[-1] = session
        else:
            self.sessions.append(session)

    def _check_settings(self, settings: dict[str, Any]) -> None:
        """All trials of a log share their settings, or they could not be compared."""
        self._settings = self._settings or settings
        for name, value in settings.items():
            if value != self._settings[name]:
                known = self._settings[name]
                raise InputError(f"{self.file}: has {name} {known}, not {value}; use the same, or another --out")
