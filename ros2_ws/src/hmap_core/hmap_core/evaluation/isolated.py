"""Trials in worker processes: a crash or a timeout affects one trial only, and its result reports it."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict
from typing import IO

from hmap_core.evaluation.trial import Trial, TrialResult

COMMAND = (sys.executable, "-m", "hmap_core.evaluation.worker")
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
MAX_SHOWN = 300  # characters of the last line of standard error that a result repeats


class Worker:
    """A single-threaded process that runs trials one after another; it is restarted after a crash or timeout.

    Args:
        command: the worker process; see :mod:`hmap_core.evaluation.worker` for its protocol.
    """

    def __init__(self, command: Sequence[str] = COMMAND):
        """
        Args:
            command: what to start; see :mod:`hmap_core.evaluation.worker` for what it has to do.
        """
        self.command = tuple(command)
        self._process: subprocess.Popen | None = None
        self._errors = tempfile.TemporaryFile()

    def run(self, trial: Trial, limit: float) -> TrialResult:
        """Runs a trial.

        Args:
            trial: the trial.
            limit: wall-clock time in seconds after which the process is killed.

        Returns:
            The result; its ``reason`` says whether the process crashed or was killed.
        """
        process = self._process or self._start()
        requests, answers = _pipes(process)
        try:
            requests.write(json.dumps(asdict(trial)).encode() + b"\n")
            requests.flush()
        except BrokenPipeError:
            return self._lost(trial, process)
        if not select.select([answers], [], [], limit)[0]:
            self.close()
            return TrialResult(trial.seed, reason=f"ended after {limit:g} s without a result")
        answer = answers.readline()
        if not answer.endswith(b"\n"):
            return self._lost(trial, process)
        return TrialResult(**json.loads(answer))

    def close(self) -> None:
        """Kills the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _start(self) -> subprocess.Popen:
        self._errors.seek(0)
        self._errors.truncate()
        process = self._process = subprocess.Popen(
            self.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=os.environ | {name: "1" for name in ONE_THREAD},
        )
        return process

    def _lost(self, trial: Trial, process: subprocess.Popen) -> TrialResult:
        self._process = None
        process.communicate()
        code = process.returncode
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        self._errors.seek(0)
        lines = [line for line in self._errors.read().decode(errors="replace").splitlines() if line.strip()]
        fatal = [line for line in lines if line.startswith("Fatal Python error")] or lines
        last = f": {fatal[-1].strip()[:MAX_SHOWN]}" if fatal else ""
        return TrialResult(trial.seed, reason=f"the process of the trial ended with {how}{last}")


def _pipes(process: subprocess.Popen) -> tuple[IO[bytes], IO[bytes]]:
    """Standard input and output of a worker process."""
    if process.stdin is None or process.stdout is None:
        raise ValueError("the worker process has no pipes")
    return process.stdin, process.stdout


_workers = threading.local()  # one worker for each thread


def run_isolated(trial: Trial, limit: float, command: Sequence[str] = COMMAND) -> TrialResult:
    """Runs a trial in this thread's worker process, which is reused and ends with this process.

    Args:
        trial: the trial.
        limit: wall-clock time in seconds after which the process is killed.
        command: the worker process.

    Returns:
        The result.
    """
    worker = getattr(_workers, "worker", None)
    if worker is None or worker.command != tuple(command):
        if worker is not None:
            worker.close()
        worker = _workers.worker = Worker(command)
    return worker.run(trial, limit)
